//! A raster's levels in memory, filtered up and coded down with any bound, without any file.

use kimberlite::codec::{
    BlockCodec, Census, Draft, Fit, LevelModel, Matrix, MatrixModel, Model, Outline, ROUNDS,
    Refined, SymbolCoder, Trainer, child_vertices,
};
use kimberlite::lattice::{Diamond, Lattice, reflect_absent_half};
use kimberlite::store::TransformKind;
use kimberlite::transform::adaptive::Weights;
use kimberlite::transform::{Quantiser, Target, Validity};
use std::collections::HashMap;

/// The heights that each level should have, of a raster without voids.
pub struct Pyramid {
    pub lattice: Lattice,
    kind: TransformKind,
    range: [i32; 2],
    root: Matrix,
    /// By diamond: vertices and centres on the next level.
    next: HashMap<Diamond, (Matrix, Matrix)>,
}

impl Pyramid {
    /// Filters the heights of a raster, `height` by column and row.
    pub fn new(lattice: Lattice, kind: TransformKind, height: impl Fn(i64, i64) -> i32) -> Pyramid {
        let (width, rows) = (i64::from(lattice.width()), i64::from(lattice.height()));
        let places = (0..width * rows).map(|k| [k % width, k / width]);
        let mut heights: HashMap<[i64; 2], i32> =
            places.map(|at| (at, height(at[0], at[1]))).collect();
        let least = heights.values().min().copied().unwrap();
        let range = [least, heights.values().max().copied().unwrap()];
        let transform = kind.transform(lattice.cells(), 0, range);
        let mut next = HashMap::new();
        for level in (0..lattice.levels()).rev() {
            for diamond in lattice.diamonds(level) {
                let outline = Outline::of(&lattice, diamond);
                let vertices = vertices_of(&lattice, diamond, &outline, &heights);
                let placement = lattice.placement(diamond);
                let cells = lattice.cells();
                let centres = matrix(cells, |index| {
                    let at = placement.centre(index % cells, index / cells);
                    outline.is_codable(index).then(|| heights[&at])
                });
                let validity = Validity {
                    vertices: vertices.valid.as_deref(),
                    centres: centres.valid.as_deref(),
                    absent: outline.absent,
                };
                let mut own = vertices.values.clone();
                transform.filter(&validity, &mut own, &centres.values);
                for (i, j) in (1..cells).flat_map(|j| (1..cells).map(move |i| (i, j))) {
                    if let Some(height) = heights.get_mut(&placement.vertex(i, j)) {
                        *height = own[j * (cells + 1) + i];
                    }
                }
                next.insert(diamond, (vertices, centres));
            }
        }
        let root = lattice.root();
        Pyramid {
            root: vertices_of(&lattice, root, &Outline::of(&lattice, root), &heights),
            lattice,
            kind,
            range,
            next,
        }
    }

    /// Codes all levels with the bound e, the root as it is. Returns the largest |decoded - filtered| on each
    /// level.
    pub fn errors(&self, bound: i32) -> Vec<i64> {
        let cells = self.lattice.cells();
        let transform = self.kind.transform(cells, bound, self.range);
        let codec = BlockCodec::new(cells, false, vec![transform]);
        self.descend(|inputs| {
            let refine =
                |input: &Input| codec.preview(&input.own, &input.outline, input.target, None);
            inputs.iter().map(refine).collect()
        })
    }

    /// The same through blocks of symbols in contexts, each level by weights and tables trained on it; centres
    /// by trained prediction where `adaptive`.
    pub fn errors_in_contexts(&self, bound: i32, adaptive: bool) -> Vec<i64> {
        let (cells, [low, high]) = (self.lattice.cells(), self.range);
        let codec = || {
            let transform = self.kind.transform(cells, bound, self.range);
            let quantiser = Quantiser::new(bound, low, high);
            let symbols = SymbolCoder::new(cells, quantiser, adaptive, true);
            BlockCodec::new(cells, false, vec![transform]).with_symbols(vec![symbols])
        };
        let levels = self.lattice.levels();
        self.descend(|inputs| {
            let encoder = codec();
            let weights = trained(&encoder, inputs);
            let draft = |input: &Input| {
                let (own, outline) = (&input.own, &input.outline);
                encoder.draft(&weights, own, outline, input.target, None)
            };
            let drafts: Vec<(Draft, Refined)> = inputs.iter().map(draft).collect();
            let model = model_of(&drafts, weights.clone());
            let decoder =
                codec().with_model(Model::new(adaptive, None, 1, vec![(model.clone(), levels)]));
            let decode = |(input, (draft, promised)): (&Input, &(Draft, Refined))| {
                let block = encoder.finish(draft, Some(&model));
                let refined = decoder.decode(&input.own, &input.outline, &block).unwrap();
                assert_eq!(&refined, promised);
                refined
            };
            inputs.iter().zip(&drafts).map(decode).collect()
        })
    }

    /// Refines level after level and compares.
    fn descend(&self, mut refine: impl FnMut(&[Input]) -> Vec<Refined>) -> Vec<i64> {
        let lattice = &self.lattice;
        let mut errors = vec![0];
        let mut coarser: HashMap<Diamond, (Matrix, Matrix)> = HashMap::new();
        for level in 0..lattice.levels() {
            let diamonds = lattice.diamonds(level);
            let input = |&diamond: &Diamond| {
                let own = if level == 0 {
                    self.root.clone()
                } else {
                    let parents = lattice.parents(diamond).map(|parent| {
                        let (vertices, centres) = &coarser[&parent?];
                        Some((vertices, centres))
                    });
                    child_vertices(lattice, diamond, parents)
                };
                let (vertices, centres) = &self.next[&diamond];
                Input {
                    own,
                    outline: Outline::of(lattice, diamond),
                    target: Target {
                        vertices: &vertices.values,
                        centres: &centres.values,
                    },
                }
            };
            let inputs: Vec<Input> = diamonds.iter().map(input).collect();
            let (mut decoded, mut largest) = (HashMap::new(), 0);
            let refined = refine(&inputs);
            for ((diamond, input), refined) in diamonds.into_iter().zip(inputs).zip(refined) {
                let (vertices, centres) = &self.next[&diamond];
                let found = refined.into_matrices(input.own);
                largest = largest
                    .max(distance(vertices, &found.0))
                    .max(distance(centres, &found.1));
                decoded.insert(diamond, found);
            }
            errors.push(largest);
            coarser = decoded;
        }
        errors
    }
}

/// What a diamond's block is made from.
struct Input<'a> {
    own: Matrix,
    outline: Outline,
    target: Target<'a>,
}

/// The weights of each matrix, trained on some diamonds.
fn trained(codec: &BlockCodec, inputs: &[Input]) -> Vec<Weights> {
    let mut trainers: Vec<Trainer> = (0..codec.matrices()).map(|_| Trainer::new()).collect();
    for _ in 0..ROUNDS {
        let mut fits = vec![Fit::new(); trainers.len()];
        for input in inputs {
            let (own, outline) = (&input.own, &input.outline);
            codec.show(&trainers, &mut fits, own, outline, input.target, None);
        }
        for (trainer, fit) in trainers.iter_mut().zip(&fits) {
            trainer.learn(fit);
        }
    }
    let weights = trainers.iter().map(|trainer| trainer.weights().clone());
    weights.collect()
}

/// The model that some drafts are best coded by.
fn model_of(drafts: &[(Draft, Refined)], weights: Vec<Weights>) -> LevelModel {
    let mut census = Census::new(weights.len());
    let traces = drafts.iter().filter_map(|(draft, _)| draft.trace());
    traces.for_each(|trace| census.add(trace));
    let matrices = weights.into_iter().enumerate();
    let model = matrices.map(|(matrix, weights)| MatrixModel {
        weights,
        frequencies: census.frequencies(matrix),
    });
    LevelModel::new(model.collect())
}

fn vertices_of(
    lattice: &Lattice,
    diamond: Diamond,
    outline: &Outline,
    heights: &HashMap<[i64; 2], i32>,
) -> Matrix {
    let (placement, side) = (lattice.placement(diamond), lattice.cells() + 1);
    let mut vertices = matrix(side, |index| {
        heights
            .get(&placement.vertex(index % side, index / side))
            .copied()
    });
    if let (Some(absent), Some(valid)) = (outline.absent, &mut vertices.valid) {
        reflect_absent_half(side - 1, absent, &mut vertices.values);
        reflect_absent_half(side - 1, absent, valid);
    }
    vertices
}

fn matrix(side: usize, height: impl Fn(usize) -> Option<i32>) -> Matrix {
    let heights: Vec<Option<i32>> = (0..side * side).map(height).collect();
    let valid = heights.iter().map(|height| u8::from(height.is_some()));
    Matrix {
        valid: Some(valid.collect()),
        values: heights.iter().map(|height| height.unwrap_or(0)).collect(),
    }
}

/// Largest difference of what is valid.
fn distance(expected: &Matrix, found: &Matrix) -> i64 {
    let heights = expected.values.iter().zip(&found.values);
    let valid = heights
        .enumerate()
        .filter(|(index, _)| expected.is_valid(*index));
    valid
        .map(|(_, (&a, &b))| (i64::from(a) - i64::from(b)).abs())
        .max()
        .unwrap_or(0)
}
