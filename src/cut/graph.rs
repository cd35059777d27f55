//! The diamonds that a cut holds with their heights, and the two operations that keep it legal: refine and
//! coarsen.

use super::births::{Birth, births_of_centres};
use super::changes::ChangeLog;
use super::node::half_from;
use super::patch::{Patch, PatchMaker};
use super::projection::Projection;
use super::samples::{Finer, Ground, Samples};
use super::skeleton::{Sizes, Skeleton};
use super::slopes::{Diagonals, Heights, Slope, root_slopes};
use super::stock::Stock;
use super::supply::Supply;
use crate::Result;
use crate::lattice::{Diamond, gather_half, reflect_absent_half};
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

/// What a diamond consists of, and what is drawn for it.
pub(super) struct Content {
    pub samples: Samples,
    pub slopes: Box<[Slope]>,
    /// Of its vertices, where the cut is to tell them.
    pub births: Option<Box<[Birth]>>,
    /// What is drawn for each half; `None` where refined, not arrived, or all void or outside.
    pub patches: [Option<Arc<Patch>>; 2],
}

impl Content {
    pub fn new(ground: &Ground, has_births: bool) -> Content {
        let samples = ground.empty();
        let entries = samples.heights.values.len();
        Content {
            slopes: vec![[0.0; 2]; entries].into(),
            births: has_births.then(|| vec![Birth::default(); entries].into()),
            samples,
            patches: [None, None],
        }
    }

    /// Bytes of its storage, patches and masks apart.
    pub fn bytes(&self) -> usize {
        let texels = self.samples.texels.as_ref();
        let texels = texels.map_or(0, |texels| size_of_val(&*texels.matrix.values));
        let births = self
            .births
            .as_ref()
            .map_or(0, |births| size_of_val(&**births));
        size_of_val(&*self.samples.heights.values) + texels + size_of_val(&*self.slopes) + births
    }
}

/// Storage of one refinement.
struct Scratch {
    vertex_slopes: Box<[Slope]>,
    centre_slopes: Box<[Slope]>,
    centre_births: Box<[Birth]>,
}

impl Graph {
    /// The root of a ground. `threads` decode; with 0, refining does.
    ///
    /// # Errors
    ///
    /// Those of the root's summaries, and [`Error::Io`](crate::Error::Io) where the system starts no more threads.
    pub fn new(ground: Ground, maker: PatchMaker, threads: usize) -> Result<Graph> {
        let source = &ground.heights;
        let (cells, lattice) = (source.lattice().cells(), source.lattice());
        let (frame, [_, unit]) = (source.frame(), source.height_to_world());
        let placement = lattice.placement(lattice.root());
        let step = [
            frame.step[0] * placement.ax[0] as f64,
            frame.step[1] * placement.ay[1] as f64,
        ];
        let samples = ground.root();
        let content = Content {
            slopes: root_slopes(cells, &samples.heights.values, step, unit),
            births: maker
                .has_births()
                .then(|| maker.first_births(&samples.heights)),
            samples,
            patches: [None, None],
        };
        let side = cells + 1;
        let mut graph = Graph {
            skeleton: Skeleton::new(ground.clone(), sizes(&ground, &maker))?,
            supply: Supply::new(ground, threads)?,
            contents: vec![Some(content)],
            maker,
            changes: ChangeLog::default(),
            stock: Stock::default(),
            scratch: Scratch {
                vertex_slopes: vec![[0.0; 2]; side * side].into(),
                centre_slopes: vec![[0.0; 2]; cells * cells].into(),
                centre_births: vec![Birth::default(); cells * cells].into(),
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
        let ground = skeleton.ground();
        self.supply.end(|ready, diamond| {
            let place = skeleton.place(diamond)?;
            let mut samples = contents[place].as_ref()?.samples.clone();
            let parents = ground.heights.lattice().parents(diamond);
            for (half, parent) in parents.into_iter().enumerate() {
                let node = &skeleton.node(place)?.halves[half];
                if node.has_arrived || !node.is_present {
                    continue;
                }
                let (above, finer) = &ready.get(&parent?)?.detail;
                let from = (parent?, above, finer.as_ref().ok()?);
                ground.receive_half(from, (diamond, &mut samples), half);
            }
            Some(samples)
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
        let finer = self.supply.take(diamond, &content.samples);
        let spread = finer.and_then(|finer| {
            self.skeleton.refine(place, update, projection)?;
            self.spread(diamond, &content, &finer);
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
    fn spread(&mut self, parent: Diamond, content: &Content, finer: &Finer) {
        let ground = self.skeleton.ground().clone();
        let lattice = ground.heights.lattice();
        self.find_slopes(parent, content, finer);
        if content.births.is_some() {
            let births = &mut self.scratch.centre_births;
            let heights = &content.samples.heights.values;
            births_of_centres(lattice, parent, heights, self.maker.base(), births);
        }
        for child in lattice.children(parent).into_iter().flatten() {
            let half = half_from(lattice, child, parent);
            let (Some(half), Some(place)) = (half, self.skeleton.place(child)) else {
                continue;
            };
            if self.contents.len() <= place {
                self.contents.resize_with(place + 1, || None);
            }
            let held = self.contents[place].take();
            let has_births = self.maker.has_births();
            let mut held = held.unwrap_or_else(|| self.stock.take_content(&ground, has_births));
            let from = (parent, &content.samples, finer);
            ground.receive_half(from, (child, &mut held.samples), half);
            self.receive((child, &mut held), half, (parent, content));
            self.contents[place] = Some(held);
            self.draw(place, half);
        }
    }

    /// Slopes of a diamond's vertices and centres on the next level into the scratch space.
    fn find_slopes(&mut self, diamond: Diamond, content: &Content, finer: &Finer) {
        let source = self.skeleton.source();
        let lattice = source.lattice();
        let (frame, [_, unit]) = (source.frame(), source.height_to_world());
        let diagonals = Diagonals::new(&lattice.placement(diamond), frame.step, unit);
        let heights = Heights {
            cells: lattice.cells(),
            vertices: &finer.heights.vertices(&content.samples.heights).values,
            centres: &finer.heights.centres.values,
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

    /// Fills what a half of a child has beside its samples, from its refined parent and the scratch space.
    fn receive(
        &self,
        (to, child): (Diamond, &mut Content),
        half: usize,
        (from, parent): (Diamond, &Content),
    ) {
        let (lattice, scratch) = (self.skeleton.source().lattice(), &self.scratch);
        let slopes = (&scratch.vertex_slopes[..], &scratch.centre_slopes[..]);
        gather_half(lattice, from, slopes, to, half, &mut child.slopes);
        let (Some(above), Some(births)) = (&parent.births, &mut child.births) else {
            return;
        };
        let both = (&above[..], &scratch.centre_births[..]);
        gather_half(lattice, from, both, to, half, births);
        if let Some(absent) = lattice.halves(to).iter().position(|present| !present) {
            reflect_absent_half(lattice.cells(), lattice.apexes(to)[absent], births);
        }
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

fn sizes(ground: &Ground, maker: &PatchMaker) -> Sizes {
    let side = ground.heights.lattice().cells() as u64 + 1;
    let births = if maker.has_births() {
        size_of::<Birth>()
    } else {
        0
    };
    let beside = side * side * (size_of::<Slope>() + births) as u64;
    let ([samples, mask], [patch, list]) = (ground.bytes(), maker.patch_bytes());
    Sizes {
        vertices: samples + beside,
        mask,
        patch,
        list,
    }
}
