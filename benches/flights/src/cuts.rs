//! The cuts that are compared.

use std::sync::Arc;

use kimberlite::Result;
use kimberlite::codec::{Matrix, Refined};
use kimberlite::cut::{Cut, CutOptions, DiamondSource, Metric, Summary, Terrain, VertexForm};
use kimberlite::geo::Frame;
use kimberlite::lattice::{Diamond, Lattice};

/// What decides how finely a cut is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// A metric, and its tolerance in pixels.
    Metric(Metric, f64),
    /// All diamonds of one level.
    Uniform(u32),
}

impl Rule {
    /// A new cut of a terrain by this rule, and the tolerance of its views.
    pub fn cut(self, terrain: &Arc<Terrain>) -> Result<(Cut, f64)> {
        match self {
            Rule::Metric(metric, tolerance) => Ok((cut(terrain.clone(), metric)?, tolerance)),
            Rule::Uniform(level) => {
                let source = Uniform {
                    terrain: terrain.clone(),
                    level,
                };
                Ok((cut(Arc::new(source), Metric::Geometric)?, 1.0))
            }
        }
    }

    /// Name and setting, as the figures have it.
    pub fn name(self) -> (&'static str, f64) {
        match self {
            Rule::Metric(Metric::Geometric, tolerance) => ("geometric", tolerance),
            Rule::Metric(Metric::Sampling, tolerance) => ("sampling", tolerance),
            Rule::Uniform(level) => ("uniform", f64::from(level)),
        }
    }
}

/// A new cut, by its metric.
pub fn cut(source: Arc<dyn DiamondSource>, metric: Metric) -> Result<Cut> {
    let options = CutOptions {
        vertex_form: VertexForm::Compact,
        metric,
        ..CutOptions::default()
    };
    Cut::new(source, options)
}

/// A terrain of which everything in sight is refined to one level, and nothing further.
struct Uniform {
    terrain: Arc<Terrain>,
    level: u32,
}

impl DiamondSource for Uniform {
    fn lattice(&self) -> &Lattice {
        self.terrain.lattice()
    }

    fn frame(&self) -> &Frame {
        self.terrain.frame()
    }

    fn height_to_world(&self) -> [f64; 2] {
        self.terrain.height_to_world()
    }

    fn has_voids(&self) -> bool {
        self.terrain.has_voids()
    }

    fn root(&self) -> &Matrix {
        self.terrain.root()
    }

    fn range(&self) -> [i32; 2] {
        self.terrain.range()
    }

    fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary> {
        let summary = self.terrain.summary(diamond, parent_range)?;
        let error = if diamond.level() < self.level {
            f64::INFINITY
        } else {
            0.0
        };
        Ok(Summary { error, ..summary })
    }

    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        self.terrain.refine(diamond, vertices)
    }
}
