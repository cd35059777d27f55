//! What is drawn of a city in a frame, and what is loaded for it, within a budget (thesis, ch. 4.4).
//!
//! A *requesting visit* goes down from the root, the largest error on the screen first, to the nodes that should be drawn, and asks
//! for what is missing; a *covering visit*, the thesis' locking one, then finds for each of them what there is: itself, its
//! children, or a quarter of the nearest node above it.

use super::city::City;
use super::layout::BlockMap;
use super::sight::Sight;
use crate::geo::View;
use crate::log::{self, LogLevel};
use crate::schedule::{Budget, Deadline, Ranked, Workers};
use crate::{Error, Result};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// All four quarters of a node.
pub const ALL_QUARTERS: u8 = 0b1111;

/// A BlockMap to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// Which node's.
    pub node: u32,
    /// Which of its quarters: bit 0 south-west, 1 south-east, 2 north-west, 3 north-east.
    pub quarters: u8,
    /// Its error on the screen in pixels.
    pub pixels: f64,
}

/// What a frame did, and what is held after it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VisitStats {
    /// Entries of the list to draw.
    pub drawn: u64,
    /// Of these, nodes of which only some quarters are drawn: the others' places are taken by children.
    pub partial: u64,
    /// BlockMaps held, and what they take.
    pub resident: u64,
    /// Bytes of these.
    pub bytes: u64,
    /// BlockMaps that came in this frame.
    pub loaded: u64,
    /// BlockMaps that went in this frame.
    pub dropped: u64,
    /// Nodes that should be drawn, or were on the way to one, and have not come.
    pub awaited: u64,
    /// Nodes that cannot be read; each was told to the log once.
    pub failed: u64,
    /// Largest error on the screen of what is drawn, in pixels.
    pub largest_error: f64,
    /// Time of the update.
    pub microseconds: f64,
    /// A budget kept out what the tolerance asks for, or it has yet to come.
    pub cut_short: bool,
    /// The bytes do not even hold the root, which is drawn all the same.
    pub budget_too_small: bool,
}

/// Why a node is asked for, the most urgent first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    /// It is seen.
    Seen,
    /// It is beside what is seen.
    Beside,
    /// It is finer than it need be.
    Finer,
}

struct Resident {
    map: Arc<BlockMap>,
    /// The last frame that drew it or wanted it.
    used: u64,
    /// How urgently this frame needs it, to draw it or what is above nodes that have not come; `None` where it does not.
    need: Option<Ranked<Reverse<u32>>>,
}

impl Resident {
    fn new(map: Arc<BlockMap>, used: u64, need: Option<Ranked<Reverse<u32>>>) -> Resident {
        Resident { map, used, need }
    }
}

type Answer = Result<BlockMap>;

/// One viewer's way through a city. One thread at a time.
pub struct Visit {
    city: Arc<City>,
    workers: Option<Workers<u32, (), Answer>>,
    resident: HashMap<u32, Resident>,
    failed: HashSet<u32>,
    /// What threads have decoded and no budget let in yet.
    ready: Vec<(u32, Answer)>,
    drawn: Vec<Drawn>,
    added: Vec<u32>,
    removed: Vec<u32>,
    frame: u64,
}

/// A node by its urgency: of those whose errors are equal, or infinite around the eye, coarse ones come first, so that something
/// finer is soon there everywhere.
type Wanted = (Class, Ranked<Reverse<u32>>);

/// What the requesting visit found.
struct Plan {
    /// Nodes that are to be divided.
    divided: HashSet<u32>,
    /// Errors on the screen of all seen nodes that were visited.
    pixels: HashMap<u32, f64>,
    wanted: Vec<Wanted>,
    is_cut_short: bool,
}

impl Visit {
    /// Of a city, by so many decoding threads; with none, updates decode themselves, until their deadline.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] where the system starts no more threads; those of reading the root.
    pub fn new(city: Arc<City>, threads: usize) -> Result<Visit> {
        let root = Arc::new(city.read(0)?);
        let source = city.clone();
        let workers = (threads > 0)
            .then(|| Workers::start(threads, move |node, ()| source.read(node)))
            .transpose()
            .map_err(Error::io(Path::new("decoding threads"), "cannot start"))?;
        Ok(Visit {
            city,
            workers,
            resident: HashMap::from([(0, Resident::new(root, 0, None))]),
            failed: HashSet::new(),
            ready: Vec::new(),
            drawn: Vec::new(),
            added: vec![0],
            removed: Vec::new(),
            frame: 0,
        })
    }

    /// The city.
    pub fn city(&self) -> &Arc<City> {
        &self.city
    }

    /// What is to be drawn, front to back.
    pub fn drawn(&self) -> &[Drawn] {
        &self.drawn
    }

    /// Nodes whose BlockMaps came with the last update.
    pub fn added(&self) -> &[u32] {
        &self.added
    }

    /// Nodes whose BlockMaps went with the last update.
    pub fn removed(&self) -> &[u32] {
        &self.removed
    }

    /// The BlockMap of a node that is held.
    pub fn block(&self, node: u32) -> Option<&Arc<BlockMap>> {
        self.resident.get(&node).map(|resident| &resident.map)
    }

    /// Bytes that each BlockMap takes.
    pub fn block_bytes(&self) -> u64 {
        let root = &self.resident[&0].map;
        (root.image.len() + root.low_heights.as_ref().map_or(0, Vec::len)) as u64
    }

    /// Finds what to draw of a view, and loads what the budget allows of what is missing. `budget.refinements` bounds BlockMaps
    /// loaded, `budget.patches` entries to draw.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a view that is none.
    pub fn update(&mut self, view: &View, budget: &Budget) -> Result<VisitStats> {
        let start = Instant::now();
        let deadline = Deadline::after(start, budget.microseconds);
        let sight = Sight::new(view)?;
        self.frame += 1;
        // What came before the first update is told with it.
        if self.frame > 1 {
            self.added.clear();
        }
        self.removed.clear();
        let each = self.block_bytes();
        let capacity = (budget.bytes / each).max(1);
        let plan = self.plan(&sight, view.tolerance, capacity, budget.patches);
        let mut stats = VisitStats {
            budget_too_small: budget.bytes < each || budget.patches < 1,
            ..VisitStats::default()
        };
        self.evict_beyond(capacity);
        let wanted = self.missing(&plan);
        let urgent = wanted
            .iter()
            .filter(|(class, _)| *class == Class::Seen)
            .count() as u64;
        let most = budget.refinements.min(budget.upload_bytes / each);
        stats.loaded = self.load(&wanted, capacity, most, &deadline);
        self.drawn.clear();
        let mut drawn = Vec::new();
        self.cover(0, &plan, &mut drawn);
        for entry in &drawn {
            if let Some(resident) = self.resident.get_mut(&entry.node) {
                resident.used = self.frame;
            }
        }
        self.front_to_back(view, &mut drawn);
        self.drawn = drawn;
        self.tell(&mut stats, &plan, each);
        stats.awaited = urgent.saturating_sub(stats.loaded);
        stats.cut_short = plan.is_cut_short || stats.awaited > 0;
        stats.microseconds = start.elapsed().as_secs_f64() * 1e6;
        Ok(stats)
    }

    fn tell(&self, stats: &mut VisitStats, plan: &Plan, each: u64) {
        stats.drawn = self.drawn.len() as u64;
        let is_partial = |entry: &&Drawn| entry.quarters != ALL_QUARTERS;
        stats.partial = self.drawn.iter().filter(is_partial).count() as u64;
        stats.resident = self.resident.len() as u64;
        stats.bytes = stats.resident * each;
        stats.dropped = self.removed.len() as u64;
        stats.failed = self.failed.len() as u64;
        let pixels = self.drawn.iter().map(|entry| {
            let own = plan.pixels.get(&entry.node).copied();
            own.unwrap_or(0.0)
        });
        stats.largest_error = pixels.fold(0.0, f64::max);
    }

    /// The requesting visit.
    fn plan(&self, sight: &Sight, tolerance: f64, capacity: u64, most_drawn: u64) -> Plan {
        let tree = self.city.tree();
        let mut plan = Plan {
            divided: HashSet::new(),
            pixels: HashMap::new(),
            wanted: Vec::new(),
            is_cut_short: false,
        };
        // One is the root's, one a parent's that waits for its children.
        let most = most_drawn.min(capacity.saturating_sub(2)).max(1);
        let mut drawn = 1;
        let mut heap = BinaryHeap::new();
        let root = sight.pixels(tree, 0);
        plan.pixels.insert(0, root);
        heap.push(Ranked {
            key: root,
            item: Reverse(0u32),
        });
        while let Some(next) = heap.pop() {
            plan.wanted.push((Class::Seen, next));
            let (key, Reverse(item)) = (next.key, next.item);
            let Some(first) = tree.nodes[item as usize].children else {
                continue;
            };
            let children = first..first + 4;
            if key <= tolerance {
                let item = |node| Ranked {
                    key,
                    item: Reverse(node),
                };
                let finer = children.map(|node| (Class::Finer, item(node)));
                plan.wanted.extend(finer);
                continue;
            }
            let seen: Vec<u32> = children
                .clone()
                .filter(|&node| sight.sees(tree, node, 0.0))
                .collect();
            if drawn + seen.len() as u64 > most + 1 {
                plan.is_cut_short = true;
                continue;
            }
            drawn = (drawn + seen.len() as u64).saturating_sub(1).max(1);
            plan.divided.insert(item);
            for node in children {
                let pixels = sight.pixels(tree, node);
                if seen.contains(&node) {
                    plan.pixels.insert(node, pixels);
                    heap.push(Ranked {
                        key: pixels,
                        item: Reverse(node),
                    });
                } else if sight.sees(tree, node, 1.0) {
                    plan.wanted.push((
                        Class::Beside,
                        Ranked {
                            key: pixels,
                            item: Reverse(node),
                        },
                    ));
                }
            }
        }
        plan
    }

    /// What is wanted and not there, the most urgent first. Nodes above those to be drawn are not wanted where these are there.
    fn missing(&mut self, plan: &Plan) -> Vec<Wanted> {
        self.resident
            .values_mut()
            .for_each(|resident| resident.need = None);
        let mut missing = Vec::new();
        for &(class, wanted) in &plan.wanted {
            let Reverse(node) = wanted.item;
            let is_idle = plan.divided.contains(&node) && self.is_covered(node, plan);
            if is_idle || self.failed.contains(&node) {
                continue;
            }
            match self.resident.get_mut(&node) {
                Some(resident) if class == Class::Seen => {
                    (resident.used, resident.need) = (self.frame, Some(wanted));
                }
                Some(_) => {}
                None => missing.push((class, wanted)),
            }
        }
        missing.sort_by(|(class, one), (other_class, other)| {
            class.cmp(other_class).then_with(|| other.cmp(one))
        });
        missing
    }

    /// Whether all that is seen of a divided node can be drawn without it.
    fn is_covered(&self, node: u32, plan: &Plan) -> bool {
        let Some(first) = self.city.tree().nodes[node as usize].children else {
            return false;
        };
        plan.divided.contains(&node)
            && (first..first + 4).all(|child| {
                !plan.pixels.contains_key(&child)
                    || self.resident.contains_key(&child)
                    || self.is_covered(child, plan)
            })
    }

    /// Brings in what is missing, at most so many. Prefetched blocks take no seen one's place.
    fn load(&mut self, wanted: &[Wanted], capacity: u64, most: u64, deadline: &Deadline) -> u64 {
        if let Some(workers) = &self.workers {
            workers.handover().collect(&mut self.ready);
            let keys = wanted.iter().map(|(_, wanted)| wanted.item.0);
            let ready: HashSet<u32> = self.ready.iter().map(|(node, _)| *node).collect();
            let keys = keys.filter(|node| !ready.contains(node)).take(64);
            workers.handover().reissue(keys, |_| Some(()));
            // Those no longer wanted are forgotten.
            let wanted: HashSet<u32> = wanted.iter().map(|(_, wanted)| wanted.item.0).collect();
            self.ready.retain(|(node, _)| wanted.contains(node));
        }
        let mut loaded = 0;
        for &(class, wanted) in wanted {
            let Reverse(item) = wanted.item;
            if loaded >= most || !self.make_room((class, wanted), capacity) {
                break;
            }
            let answer = match self.workers {
                None if deadline.is_past(Instant::now()) => break,
                None => Some(self.city.read(item)),
                Some(_) => {
                    let place = self.ready.iter().position(|(node, _)| *node == item);
                    place.map(|place| self.ready.swap_remove(place).1)
                }
            };
            match answer {
                None => {}
                Some(Ok(map)) => {
                    let need = (class == Class::Seen).then_some(wanted);
                    let block = Resident::new(Arc::new(map), self.frame, need);
                    self.resident.insert(item, block);
                    self.added.push(item);
                    loaded += 1;
                }
                Some(Err(error)) => {
                    log::log(LogLevel::Warning, &error.to_string());
                    self.failed.insert(item);
                }
            }
        }
        loaded
    }

    /// Whether there is room for one more, after a less urgent block has gone if need be.
    fn make_room(&mut self, (class, wanted): Wanted, capacity: u64) -> bool {
        if (self.resident.len() as u64) < capacity {
            return true;
        }
        let Some(node) = self.least_needed() else {
            return false;
        };
        let resident = &self.resident[&node];
        let gives_way = match (class, resident.need) {
            (Class::Seen, None) => true,
            (Class::Seen, Some(need)) => need < wanted,
            // What was drawn in the last frame is not given for what may be.
            (_, None) => resident.used + 1 < self.frame,
            (_, Some(_)) => false,
        };
        if gives_way {
            self.drop_block(node);
        }
        gives_way
    }

    /// Of those that are not needed the one that was not used for longest, else the least urgent; never the root.
    fn least_needed(&self) -> Option<u32> {
        let all = self.resident.iter().filter(|(node, _)| **node != 0);
        // The deepest first among equals, since coarser ones stand for more.
        all.map(|(node, resident)| (resident.need, resident.used, Reverse(*node)))
            .min()
            .map(|(.., Reverse(node))| node)
    }

    fn drop_block(&mut self, node: u32) {
        self.resident.remove(&node);
        match self.added.iter().position(|added| *added == node) {
            Some(place) => {
                self.added.swap_remove(place);
            }
            None => self.removed.push(node),
        }
    }

    fn evict_beyond(&mut self, capacity: u64) {
        while self.resident.len() as u64 > capacity {
            match self.least_needed() {
                Some(node) => self.drop_block(node),
                None => return,
            }
        }
    }

    /// The covering visit: appends what is drawn of a seen node; false where there is nothing that could be.
    fn cover(&self, node: u32, plan: &Plan, drawn: &mut Vec<Drawn>) -> bool {
        let is_resident = self.resident.contains_key(&node);
        let pixels = plan.pixels.get(&node).copied().unwrap_or(0.0);
        if is_resident && !plan.divided.contains(&node) {
            drawn.push(Drawn {
                node,
                quarters: ALL_QUARTERS,
                pixels,
            });
            return true;
        }
        let Some(first) = self.city.tree().nodes[node as usize].children else {
            return false;
        };
        let before = drawn.len();
        let mut missing = 0u8;
        for quarter in 0..4 {
            let child = first + quarter;
            let is_unseen = plan.divided.contains(&node) && !plan.pixels.contains_key(&child);
            if is_unseen || self.cover(child, plan, drawn) {
                continue;
            }
            missing |= 1 << quarter;
            if !is_resident {
                drawn.truncate(before);
                return false;
            }
        }
        if missing != 0 {
            drawn.push(Drawn {
                node,
                quarters: missing,
                pixels,
            });
        }
        true
    }

    fn front_to_back(&self, view: &View, drawn: &mut [Drawn]) {
        let tree = self.city.tree();
        let distance = |entry: &Drawn| {
            let (corner, side) = tree.square(&tree.nodes[entry.node as usize]);
            let off = [0, 1].map(|axis| {
                let low = corner[axis] - view.eye[axis];
                low.max(-(low + side)).max(0.0)
            });
            off[0] * off[0] + off[1] * off[1]
        };
        drawn.sort_by(|one, other| {
            let nearer = distance(one).total_cmp(&distance(other));
            nearer.then(one.node.cmp(&other.node))
        });
    }
}
