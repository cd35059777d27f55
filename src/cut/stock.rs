//! Storage that diamonds and patches have left, for those that come.

use super::graph::Content;
use super::patch::Patch;
use super::samples::Ground;
use std::sync::Arc;

/// Most pieces kept of a kind. A still flight exchanges fewer in a frame.
const MOST: usize = 256;

/// Its bytes come under the cut's budget, beside what is held.
#[derive(Default)]
pub(super) struct Stock {
    contents: Vec<Content>,
    vertices: Vec<Box<[f32]>>,
    /// Patches no longer drawn. Others may still hold them.
    retired: Vec<Arc<Patch>>,
}

impl Stock {
    /// Storage for a diamond none of whose halves has arrived.
    pub fn take_content(&mut self, ground: &Ground, has_births: bool) -> Content {
        let stored = self.contents.pop();
        stored.unwrap_or_else(|| Content::new(ground, has_births))
    }

    /// Storage for so many floats, as many as any patch of the cut has.
    pub fn take_vertices(&mut self, floats: usize) -> Box<[f32]> {
        let stored = self.vertices.pop();
        stored.unwrap_or_else(|| vec![0.0; floats].into())
    }

    pub fn give_content(&mut self, mut content: Content) {
        if self.contents.len() < MOST {
            content.samples.clear();
            self.contents.push(content);
        }
    }

    pub fn retire(&mut self, patch: Arc<Patch>) {
        self.retired.push(patch);
    }

    /// Takes over the storage of retired patches that nobody holds any more, and forgets the others; keeps no more than
    /// so many bytes.
    pub fn sweep(&mut self, most_bytes: u64) {
        for patch in self.retired.drain(..).filter_map(Arc::into_inner) {
            if self.vertices.len() < MOST {
                self.vertices.push(patch.vertices);
            }
        }
        let mut bytes = self.bytes();
        while bytes > most_bytes {
            if self.vertices.pop().is_none() && self.contents.pop().is_none() {
                return;
            }
            bytes = self.bytes();
        }
    }

    fn bytes(&self) -> u64 {
        let patch = self.vertices.first().map_or(0, |all| size_of_val(&**all));
        let content = self.contents.first().map_or(0, |content| content.bytes());
        (patch * self.vertices.len() + content * self.contents.len()) as u64
    }
}
