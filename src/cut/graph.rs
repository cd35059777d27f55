//! The diamonds that a cut holds with their heights, and the two operations that keep it legal: refine and
//! coarsen.

use super::DiamondSource;
use super::changes::ChangeLog;
use super::node::half_from;
use super::patch::{Patch, PatchMaker, VertexForm};
use super::projection::Projection;
use super::skeleton::{Sizes, Skeleton};
use super::slopes::{Diagonals, Heights, Slope, root_slopes};
use super::stock::Stock;
use super::supply::Supply;
use crate::Result;
use crate::codec::{Matrix, Refined};
use crate::lattice::{Diamond, Lattice, gather_half, reflect_absent_half};
use std::sync::Arc;

/// A skeleton and what its diamonds hold.
pub(super) struct Graph {
    skeleton: Skeleton,
    /// By the places of the skeleton.
    contents: Vec<Option<Content>>,
    maker: PatchMaker,
    changes: ChangeLog,
    stock: Stock,
    supply: Supply,
    scratch: Scratch,
}

/// The heights of a diamond, and what is drawn for it.
pub(super) struct Content {
    /// Vertex matrix; only halves that have arrived mean anything, and an absent half mirrors them.
    pub vertices: Matrix,
    pub slopes: Box<[Slope]>,
    /// What is drawn for each half; `None` where refined, not arrived, or all void or outside.
    pub patches: [Option<Arc<Patch>>; 2],
}

impl Content {
    pub fn new(lattice: &Lattice) -> Content {
        let entries = (lattice.cells() + 1) * (lattice.cells() + 1);
        Content {
            vertices: Matrix {
                values: vec![0; entries].into(),
                valid: None,
            },
            slopes: vec![[0.0; 2]; entries].into(),
            patches: [None, None],
        }
    }
}

/// Storage of one refinement.
struct Scratch {
    vertex_slopes: Box<[Slope]>,
    centre_slopes: Box<[Slope]>,
    all_valid: Box<[u8]>,
}

impl Graph {
    pub fn new(source: Arc<dyn DiamondSource>, form: VertexForm, threads: usize) -> Result<Graph> {
        let lattice = source.lattice();
        let (cells, root) = (lattice.cells(), lattice.root());
        let maker = PatchMaker::new(&*source, form);
        let skeleton = Skeleton::new(source.clone(), sizes(cells, &maker))?;
        let (frame, [_, unit]) = (source.frame(), source.height_to_world());
        let placement = lattice.placement(root);
        let step = [
            frame.step[0] * placement.ax[0] as f64,
            frame.step[1] * placement.ay[1] as f64,
        ];
        let content = Content {
            slopes: root_slopes(cells, &source.root().values, step, unit),
            vertices: source.root().clone(),
            patches: [None, None],
        };
        let side = cells + 1;
        let supply = Supply::new(source.clone(), threads)?;
        let mut graph = Graph {
            skeleton,
            supply,
            contents: vec![Some(content)],
            maker,
            changes: ChangeLog::default(),
            stock: Stock::default(),
            scratch: Scratch {
                vertex_slopes: vec![[0.0; 2]; side * side].into(),
                centre_slopes: vec![[0.0; 2]; cells * cells].into(),
                all_valid: vec![1; side * side].into(),
            },
        };
        (0..2).for_each(|half| graph.draw(0, half));
        Ok(graph)
    }

    /// What is known of it without heights.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// The same, to look through a view or to try something and take it back.
    pub fn skeleton_mut(&mut self) -> &mut Skeleton {
        &mut self.skeleton
    }

    pub fn maker(&self) -> &PatchMaker {
        &self.maker
    }

    pub fn changes(&mut self) -> &mut ChangeLog {
        &mut self.changes
    }

    /// What decodes its diamonds.
    pub fn supply(&mut self) -> &mut Supply {
        &mut self.supply
    }

    /// Asks for the details that are wanted, and gives their number.
    pub fn ask(&mut self) -> u64 {
        let (skeleton, contents) = (&self.skeleton, &self.contents);
        let (lattice, all_valid) = (skeleton.source().lattice(), &*self.scratch.all_valid);
        self.supply.end(|ready, diamond| {
            let place = skeleton.place(diamond)?;
            let mut vertices = contents[place].as_ref()?.vertices.clone();
            for (half, parent) in lattice.parents(diamond).into_iter().enumerate() {
                let node = &skeleton.node(place)?.halves[half];
                if node.has_arrived || !node.is_present {
                    continue;
                }
                let (above, refined) = &ready.get(&parent?)?.detail;
                let refined = refined.as_ref().ok()?;
                let from = (refined.vertices(above), &refined.centres);
                receive_half(
                    lattice,
                    (parent?, from),
                    (diamond, &mut vertices),
                    half,
                    all_valid,
                );
            }
            Some(vertices)
        })
    }

    /// Makes the storage of patches that are no longer held ready for others, within what a budget of bytes leaves.
    pub fn sweep(&mut self, budget: u64) {
        self.stock
            .sweep(budget.saturating_sub(self.skeleton.bytes()));
    }

    /// Bytes of the patches that this update hands out so far.
    pub fn uploaded(&self) -> u64 {
        self.changes.uploaded()
    }

    /// What is drawn for a half.
    pub fn patch(&self, place: usize, half: usize) -> Option<&Arc<Patch>> {
        self.contents.get(place)?.as_ref()?.patches[half].as_ref()
    }

    /// Every patch drawn.
    pub fn patches(&self) -> impl Iterator<Item = &Arc<Patch>> {
        let contents = self.contents.iter().flatten();
        contents.flat_map(|content| content.patches.iter().flatten())
    }

    /// Refines a node all of whose parents are refined. When the source fails nothing changes, but the
    /// node can no longer be refined.
    pub fn refine(&mut self, place: usize, update: u64, projection: &Projection) -> Result<()> {
        let Some(diamond) = self.skeleton.node(place).map(|node| node.diamond) else {
            return Ok(());
        };
        let Some(mut content) = self.contents[place].take() else {
            return Ok(());
        };
        let refined = self.supply.take(diamond, &content.vertices);
        let spread = refined.and_then(|refined| {
            self.skeleton.refine(place, update, projection)?;
            self.spread(diamond, &content, &refined);
            Ok(())
        });
        match &spread {
            Ok(()) => (0..2).for_each(|half| self.erase(&mut content, half)),
            Err(_) => self.skeleton.give_up(diamond),
        }
        self.contents[place] = Some(content);
        spread
    }

    /// Gives a node's children the halves that come from it.
    fn spread(&mut self, parent: Diamond, content: &Content, refined: &Refined) {
        let source = self.skeleton.source().clone();
        let lattice = source.lattice();
        self.find_slopes(parent, content, refined);
        for child in lattice.children(parent).into_iter().flatten() {
            let half = half_from(lattice, child, parent);
            let (Some(half), Some(place)) = (half, self.skeleton.place(child)) else {
                continue;
            };
            if self.contents.len() <= place {
                self.contents.resize_with(place + 1, || None);
            }
            let held = self.contents[place].take();
            let mut held = held.unwrap_or_else(|| self.stock.take_content(lattice));
            self.receive(child, &mut held, half, parent, (content, refined));
            self.contents[place] = Some(held);
            self.draw(place, half);
        }
    }

    /// Slopes of a diamond's vertices and centres on the next level into the scratch space.
    fn find_slopes(&mut self, diamond: Diamond, content: &Content, refined: &Refined) {
        let source = self.skeleton.source();
        let lattice = source.lattice();
        let (frame, [_, unit]) = (source.frame(), source.height_to_world());
        let diagonals = Diagonals::new(&lattice.placement(diamond), frame.step, unit);
        let heights = Heights {
            cells: lattice.cells(),
            vertices: &refined.vertices(&content.vertices).values,
            centres: &refined.centres.values,
        };
        let Scratch {
            vertex_slopes,
            centre_slopes,
            ..
        } = &mut self.scratch;
        copy_boundary(lattice.cells() + 1, &content.slopes, vertex_slopes);
        heights.inner_slopes(&diagonals, vertex_slopes, centre_slopes);
        let half = match lattice.halves(diamond) {
            [true, false] => 0,
            [false, true] => 1,
            _ => return,
        };
        let apex = lattice.apexes(diamond)[half];
        heights.hypotenuse_slopes(&diagonals, apex, vertex_slopes, centre_slopes);
    }

    /// Fills a half of `child` from its refined parent and the slopes in the scratch space.
    fn receive(
        &self,
        to: Diamond,
        child: &mut Content,
        half: usize,
        from: Diamond,
        (parent, refined): (&Content, &Refined),
    ) {
        let (lattice, scratch) = (self.skeleton.source().lattice(), &self.scratch);
        let matrices = (refined.vertices(&parent.vertices), &refined.centres);
        let vertices = &mut child.vertices;
        receive_half(
            lattice,
            (from, matrices),
            (to, vertices),
            half,
            &scratch.all_valid,
        );
        let slopes = (&scratch.vertex_slopes[..], &scratch.centre_slopes[..]);
        gather_half(lattice, from, slopes, to, half, &mut child.slopes);
    }

    /// Takes back a refinement; no child may be refined.
    pub fn coarsen(&mut self, place: usize, projection: &Projection) {
        let source = self.skeleton.source().clone();
        let lattice = source.lattice();
        let Some(diamond) = self.skeleton.node(place).map(|node| node.diamond) else {
            return;
        };
        let children = lattice.children(diamond).map(|child| {
            let child = child?;
            Some((
                self.skeleton.place(child)?,
                half_from(lattice, child, diamond)?,
            ))
        });
        self.skeleton.coarsen(place, projection);
        for (child, half) in children.into_iter().flatten() {
            let Some(mut content) = self.contents[child].take() else {
                continue;
            };
            self.erase(&mut content, half);
            if self.skeleton.node(child).is_some() {
                self.contents[child] = Some(content);
            } else {
                self.stock.give_content(content);
            }
        }
        let present = lattice.halves(diamond);
        for half in (0..2).filter(|&half| present[half]) {
            self.draw(place, half);
        }
    }

    fn draw(&mut self, place: usize, half: usize) {
        let (node, content) = (self.skeleton.node(place), self.contents[place].as_mut());
        let (Some(node), Some(content)) = (node, content) else {
            return;
        };
        let handle = self.changes.next_handle();
        let patch = self
            .maker
            .make(node, content, (half, handle), &mut self.stock)
            .map(Arc::new);
        if let Some(patch) = &patch {
            debug_assert!(node.halves[half].in_domain && patch.bytes() <= node.room.patch);
            self.changes.add(patch);
        }
        content.patches[half] = patch;
    }

    fn erase(&mut self, content: &mut Content, half: usize) {
        if let Some(patch) = content.patches[half].take() {
            self.changes.remove(&patch);
            self.stock.retire(patch);
        }
    }
}

/// Fills a half of the vertices of `to` from its parent's vertices and centres on its level, and the absent half by
/// reflection.
fn receive_half(
    lattice: &Lattice,
    (from, (vertices, centres)): (Diamond, (&Matrix, &Matrix)),
    (to, child): (Diamond, &mut Matrix),
    half: usize,
    all_valid: &[u8],
) {
    let heights = (&vertices.values[..], &centres.values[..]);
    gather_half(lattice, from, heights, to, half, &mut child.values);
    let matrices = [vertices, centres, &*child];
    let is_masked = matrices.iter().any(|matrix| matrix.valid.is_some());
    let mut mask = is_masked.then(|| {
        let own = child.valid.take();
        own.unwrap_or_else(|| all_valid.into())
    });
    if let Some(mask) = &mut mask {
        let vertices = vertices.valid.as_deref().unwrap_or(all_valid);
        let centres = centres.valid.as_deref().unwrap_or(all_valid);
        gather_half(lattice, from, (vertices, centres), to, half, mask);
    }
    if let Some(absent) = lattice.halves(to).iter().position(|present| !present) {
        let apex = lattice.apexes(to)[absent];
        reflect_absent_half(lattice.cells(), apex, &mut child.values);
        if let Some(mask) = &mut mask {
            reflect_absent_half(lattice.cells(), apex, mask);
        }
    }
    child.valid = mask.filter(|mask| mask.contains(&0));
}

/// Copies the outermost rows and columns of a square matrix.
fn copy_boundary(side: usize, from: &[Slope], to: &mut [Slope]) {
    let last = side * (side - 1);
    to[..side].copy_from_slice(&from[..side]);
    to[last..].copy_from_slice(&from[last..]);
    for row in (side..last).step_by(side) {
        to[row] = from[row];
        to[row + side - 1] = from[row + side - 1];
    }
}

fn sizes(cells: usize, maker: &PatchMaker) -> Sizes {
    let entries = ((cells + 1) * (cells + 1)) as u64;
    let [patch, list] = maker.patch_bytes();
    Sizes {
        vertices: entries * (size_of::<i32>() + size_of::<Slope>()) as u64,
        mask: entries,
        patch,
        list,
    }
}
