//! The details of diamonds: decoded when they are needed, or ahead of it by threads.

use super::samples::{Finer, Ground, Samples};
use crate::lattice::Diamond;
use crate::schedule::{Ranked, Workers};
use crate::{Error, Result};
use std::cmp::Reverse;
use std::collections::HashMap;
use std::path::Path;

/// Most requests for each thread: about what it decodes between two frames.
const REQUESTS: u64 = 64;
/// The part of a cut's bytes that requests and answers may take, but for those of one chain.
const SHARE: u64 = 8;

/// Where a cut gets the details of its diamonds from.
pub(super) struct Supply {
    ground: Ground,
    /// None where the cut decodes for itself.
    workers: Option<Workers<Diamond, Samples, Answer>>,
    threads: u64,
    /// Bytes of a diamond on its way.
    each: u64,
    /// Room that any chain needs: two diamonds of each level.
    least: u64,
    /// Most that may be wanted or ready.
    capacity: usize,
    ready: HashMap<Diamond, Ready>,
    /// Not ready, and asked for since the update began. By urgency: coarse to fine where errors are equal.
    wanted: Vec<Wanted>,
    /// The same of what may be needed in later updates.
    wanted_later: Vec<Wanted>,
    answers: Vec<(Diamond, Answer)>,
    updates: u64,
}

type Wanted = Ranked<(Reverse<u32>, Diamond)>;

/// A diamond on its own level and on the next.
pub(super) type Answer = (Samples, Result<Finer>);

/// An answer that is not used yet.
pub(super) struct Ready {
    pub detail: Answer,
    /// The update in which it came or was looked for last.
    looked_for: u64,
}

impl Supply {
    /// A supply by so many threads; with none, all is decoded when it is taken.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] where the system starts no more threads.
    pub fn new(ground: Ground, threads: usize) -> Result<Supply> {
        let decoder = ground.clone();
        let work = move |diamond, own: Samples| {
            let finer = decoder.refine(diamond, &own);
            (own, finer)
        };
        let workers = (threads > 0)
            .then(|| Workers::start(threads, work))
            .transpose()
            .map_err(Error::io(Path::new("decoding threads"), "cannot start"))?;
        // Vertices on both levels and centres, fewer than these, with their masks.
        let each = 3 * ground.bytes().iter().sum::<u64>();
        let least = 2 * u64::from(ground.heights.lattice().levels().max(1));
        Ok(Supply {
            ground,
            workers,
            threads: threads as u64,
            each,
            least,
            capacity: 0,
            ready: HashMap::new(),
            wanted: Vec::new(),
            wanted_later: Vec::new(),
            answers: Vec::new(),
            updates: 0,
        })
    }

    /// Sets aside bytes of a budget for what is on its way or ready, and for what is in work without being wanted any
    /// more. Gives their number.
    pub fn reserve(&mut self, budget: u64) -> u64 {
        if self.threads == 0 {
            return 0;
        }
        let share = budget / SHARE / self.each;
        let capacity = share.min(REQUESTS * self.threads).max(self.least);
        self.capacity = capacity as usize;
        self.each * (capacity + self.threads)
    }

    /// Begins an update: takes what has come.
    pub fn begin(&mut self) {
        self.updates += 1;
        self.wanted.clear();
        self.wanted_later.clear();
        let Some(workers) = &self.workers else { return };
        workers.handover().collect(&mut self.answers);
        for (diamond, detail) in self.answers.drain(..) {
            let looked_for = self.updates;
            self.ready.insert(diamond, Ready { detail, looked_for });
        }
        let most = self.capacity + self.threads as usize;
        while self.ready.len() > most && self.forget_one() {}
    }

    /// Whether a detail can be taken now.
    pub fn has(&mut self, diamond: Diamond) -> bool {
        if self.workers.is_none() {
            return true;
        }
        let ready = self.ready.get_mut(&diamond);
        ready.map(|ready| ready.looked_for = self.updates).is_some()
    }

    /// Why a detail will never come, if that is known; told once.
    pub fn take_failure(&mut self, diamond: Diamond) -> Option<Error> {
        let ready = self.ready.get(&diamond)?;
        ready.detail.1.as_ref().err()?;
        self.ready.remove(&diamond)?.detail.1.err()
    }

    /// Asks for a detail that is not there, with the error on the screen that it would lower. False where too many are
    /// wanted already.
    pub fn want(&mut self, diamond: Diamond, error: f64) -> bool {
        if self.wanted.iter().any(|wanted| wanted.item.1 == diamond) {
            return true;
        }
        if self.wanted.len() + self.ready.len() >= self.capacity && !self.forget_one() {
            return false;
        }
        self.wanted.push(wanted(diamond, error));
        true
    }

    /// Asks for a detail that may be needed in later updates, if nothing else wants its room. False where there is none.
    pub fn want_later(&mut self, diamond: Diamond, error: f64) -> bool {
        let all = self.wanted.len() + self.wanted_later.len() + self.ready.len();
        let has_room = all < self.capacity;
        if has_room {
            self.wanted_later.push(wanted(diamond, error));
        }
        has_room
    }

    /// Forgets what nobody has looked for the longest.
    fn forget_one(&mut self) -> bool {
        let ages = self.ready.iter();
        let oldest = ages
            .map(|(diamond, ready)| (ready.looked_for, *diamond))
            .min();
        match oldest.filter(|(looked_for, _)| *looked_for < self.updates) {
            Some((_, diamond)) => self.ready.remove(&diamond).is_some(),
            None => false,
        }
    }

    /// The detail of a diamond with these samples.
    ///
    /// # Errors
    ///
    /// Those of [`Ground::refine`].
    pub fn take(&mut self, diamond: Diamond, own: &Samples) -> Result<Finer> {
        match self.ready.remove(&diamond) {
            Some(ready) => ready.detail.1,
            None => self.ground.refine(diamond, own),
        }
    }

    /// Ends an update: asks for what is wanted, and for nothing else any more. Gives the number of what is wanted now.
    /// `samples` gives those of a diamond, with the help of what is ready, or `None` where they cannot be known yet.
    pub fn end(
        &mut self,
        samples: impl Fn(&HashMap<Diamond, Ready>, Diamond) -> Option<Samples>,
    ) -> u64 {
        let Some(workers) = &self.workers else {
            return 0;
        };
        for wanted in [&mut self.wanted, &mut self.wanted_later] {
            wanted.sort_unstable_by(|a, b| b.cmp(a));
        }
        let all = self.wanted.iter().chain(&self.wanted_later);
        let request = |diamond| samples(&self.ready, diamond);
        let diamonds = all.map(|wanted| wanted.item.1);
        workers.handover().reissue(diamonds, request);
        self.wanted.len() as u64
    }
}

fn wanted(diamond: Diamond, error: f64) -> Wanted {
    Ranked {
        key: error,
        item: (Reverse(diamond.level()), diamond),
    }
}
