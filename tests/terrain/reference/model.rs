//! Prediction, quantiser, and what a raster becomes.

use std::collections::{BTreeMap, BTreeSet};

use super::lattice::{Diamond, Index, Lattice, Point};

/// The input: heights in units, row by row; `None` is a void.
#[derive(Clone, Debug)]
pub struct Raster {
    pub width: usize,
    pub height: usize,
    pub samples: Vec<Option<i64>>,
    /// Lowest and highest unit that a decoder may give.
    pub range: (i64, i64),
}

impl Raster {
    /// A raster whose range is that of its samples; 0 to 0 where all are void.
    pub fn new(width: usize, height: usize, samples: Vec<Option<i64>>) -> Raster {
        assert_eq!(samples.len(), width * height);
        let valid = || samples.iter().flatten().copied();
        let range = (valid().min().unwrap_or(0), valid().max().unwrap_or(0));
        Raster {
            width,
            height,
            samples,
            range,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vertex {
    /// What a decoder has there; in a half that is not present, the reflection.
    pub value: i64,
    /// Neither void nor outside.
    pub valid: bool,
}

/// What is known of one diamond. Matrices are row by row.
#[derive(Clone, Debug)]
pub struct Record {
    /// (N + 1)^2.
    pub vertices: Vec<Vertex>,
    /// N^2 of a refinable diamond, none of a leaf; `None` where nothing is coded. With bound 0 they
    /// wrap in 32 bits.
    pub coefficients: Vec<Option<i32>>,
    /// What a decoder has at the centres, coded or not: N^2 of a refinable diamond, none of a leaf;
    /// `None` in a half that is not present.
    pub centres: Vec<Option<i64>>,
}

/// A raster, encoded.
#[derive(Clone, Debug)]
pub struct Model {
    pub lattice: Lattice,
    pub raster: Raster,
    /// e, in units.
    pub bound: i64,
    /// All diamonds.
    pub diamonds: BTreeMap<Diamond, Record>,
    /// What a decoder has at every vertex of every diamond's present halves.
    pub values: BTreeMap<Point, i64>,
}

/// Encodes a raster with 2^`cells_log2` cells a side and the bound `bound` >= 0 in units; root
/// vertices are kept as they are.
pub fn encode(raster: &Raster, cells_log2: u32, bound: i64) -> Model {
    encode_from(raster, cells_log2, bound, |_, input| input)
}

/// As [`encode`], with `root` giving what a decoder has at a valid root vertex, from its index and
/// input.
pub fn encode_from(
    raster: &Raster,
    cells_log2: u32,
    bound: i64,
    root: impl Fn(Index, i64) -> i64,
) -> Model {
    let lattice = Lattice::new(raster.width, raster.height, cells_log2);
    let (raster, values) = (raster.clone(), BTreeMap::new());
    let mut model = Model {
        lattice,
        raster,
        bound,
        diamonds: BTreeMap::new(),
        values,
    };
    model.place_root(root);
    for diamond in model.lattice.diamonds() {
        let mut coefficients = Vec::new();
        let mut centres = Vec::new();
        if diamond.level < model.lattice.leaf_level() {
            let matrix = model.lattice.matrix(diamond, &model.values);
            for index in model.lattice.centre_indices() {
                let centre = model.encode_centre(diamond, &matrix, index);
                coefficients.push(centre.and_then(|(coefficient, _)| coefficient));
                centres.push(centre.map(|(_, value)| value));
            }
        }
        let vertices = model.vertices(diamond);
        model.diamonds.insert(
            diamond,
            Record {
                vertices,
                coefficients,
                centres,
            },
        );
    }
    model
}

impl Model {
    /// The input's value, if the point is valid.
    pub fn input(&self, point: Point) -> Option<i64> {
        self.raster.samples[self.lattice.sample(point)?]
    }

    fn place_root(&mut self, root: impl Fn(Index, i64) -> i64) {
        let indices = self.lattice.vertex_indices();
        let place = |index| self.lattice.vertex(self.lattice.root(), index);
        let valid: Vec<(Index, i64)> = indices
            .iter()
            .filter_map(|index| Some((*index, root(*index, self.input(place(*index))?))))
            .collect();
        let (low, high) = self.raster.range;
        for (i, j) in indices {
            // The first of several nearest ones: lowest index.
            let nearest = valid
                .iter()
                .min_by_key(|((vi, vj), _)| (vi - i).pow(2) + (vj - j).pow(2));
            let value = nearest.map_or((low + high).div_euclid(2), |(_, value)| *value);
            self.values.insert(place((i, j)), value);
        }
    }

    fn vertices(&self, diamond: Diamond) -> Vec<Vertex> {
        let matrix = self.lattice.matrix(diamond, &self.values);
        let valid = |index| self.input(self.lattice.vertex(diamond, index)).is_some();
        let indices = self.lattice.vertex_indices().into_iter();
        indices
            .map(|index| Vertex {
                value: matrix[&index],
                valid: valid(index),
            })
            .collect()
    }

    /// The coefficient, if one is coded, and the value of a centre in a present half.
    fn encode_centre(
        &mut self,
        diamond: Diamond,
        matrix: &BTreeMap<Index, i64>,
        index: Index,
    ) -> Option<(Option<i32>, i64)> {
        if !self.lattice.is_predicted(diamond, index) {
            return None;
        }
        let point = self.lattice.centre(diamond, index);
        let prediction = predict(matrix, index, self.lattice.cells, self.raster.range);
        let coefficient = self.input(point).map(|input| {
            let coefficient = (input - prediction + self.bound).div_euclid(2 * self.bound + 1);
            let wrapped = coefficient as i32;
            assert!(self.bound == 0 || i64::from(wrapped) == coefficient);
            wrapped
        });
        let value = self.reconstruct(prediction, coefficient);
        let before = self.values.insert(point, value);
        assert_eq!(before, None, "{point:?} has two values");
        Some((coefficient, value))
    }

    fn reconstruct(&self, prediction: i64, coefficient: Option<i32>) -> i64 {
        let (low, high) = self.raster.range;
        match coefficient {
            None => prediction,
            Some(k) if self.bound == 0 => i64::from((prediction as i32).wrapping_add(k)),
            Some(k) => (prediction + i64::from(k) * (2 * self.bound + 1)).clamp(low, high),
        }
    }
}

impl Lattice {
    /// Whether a centre lies in a present half, so that it has a value.
    pub fn is_predicted(&self, diamond: Diamond, index: Index) -> bool {
        let present = self.present(diamond);
        (0..2).any(|half| present[half] && self.half_has_centre(diamond, half, index))
    }

    /// A diamond's vertices out of the values of its present halves, with the other half reflected.
    fn matrix(&self, diamond: Diamond, values: &BTreeMap<Point, i64>) -> BTreeMap<Index, i64> {
        let present = self.present(diamond);
        let value = |index: Index| {
            let inside =
                (0..2).any(|half| present[half] && self.half_has_vertex(diamond, half, index));
            let index = if inside {
                index
            } else {
                self.reflection(diamond, index)
            };
            values[&self.vertex(diamond, index)]
        };
        self.vertex_indices()
            .into_iter()
            .map(|index| (index, value(index)))
            .collect()
    }
}

/// The value predicted at centre (i, j) from a full matrix of vertices, N cells a side.
pub fn predict(matrix: &BTreeMap<Index, i64>, (i, j): Index, cells: i64, range: (i64, i64)) -> i64 {
    let sum = |steps: &[Index]| -> i64 {
        steps
            .iter()
            .map(|(right, down)| matrix[&(i + right, j + down)])
            .sum()
    };
    let nearest = sum(&[(0, 0), (1, 0), (0, 1), (1, 1)]);
    let inside = i >= 1 && j >= 1 && i + 2 <= cells && j + 2 <= cells;
    let prediction = if inside {
        let next = [
            (-1, 0),
            (-1, 1),
            (2, 0),
            (2, 1),
            (0, -1),
            (1, -1),
            (0, 2),
            (1, 2),
        ];
        (10 * nearest - sum(&next) + 16) >> 5
    } else {
        (nearest + 2) >> 2
    };
    prediction.clamp(range.0, range.1)
}

/// Decodes a model diamond by diamond, in any legal order, with nothing but the root's values, the
/// coefficients, and for each diamond the values that came with its halves.
#[derive(Clone, Debug)]
pub struct Decoder<'a> {
    pub model: &'a Model,
    pub refined: BTreeSet<Diamond>,
    /// The drawn halves (diamond, 0 or 1), each with the values of its vertices.
    pub halves: BTreeMap<(Diamond, usize), BTreeMap<Point, i64>>,
}

impl<'a> Decoder<'a> {
    pub fn new(model: &'a Model) -> Decoder<'a> {
        let mut decoder = Decoder {
            model,
            refined: BTreeSet::new(),
            halves: BTreeMap::new(),
        };
        let (lattice, root) = (&model.lattice, model.lattice.root());
        let vertices = lattice
            .vertex_indices()
            .into_iter()
            .zip(&model.diamonds[&root].vertices);
        let values: BTreeMap<Point, i64> = vertices
            .map(|(index, vertex)| (lattice.vertex(root, index), vertex.value))
            .collect();
        decoder.scatter(root, 0, &values);
        decoder.scatter(root, 1, &values);
        decoder
    }

    /// The diamonds that may be refined next.
    pub fn refinable(&self) -> Vec<Diamond> {
        let lattice = &self.model.lattice;
        let drawn: BTreeSet<Diamond> = self.halves.keys().map(|(diamond, _)| *diamond).collect();
        let ready = |diamond: &Diamond| {
            let parents = lattice.parents(*diamond);
            diamond.level < lattice.leaf_level()
                && parents
                    .iter()
                    .flatten()
                    .all(|parent| self.refined.contains(parent))
        };
        drawn.into_iter().filter(ready).collect()
    }

    /// Refines a diamond: its halves go, halves of its children come.
    pub fn refine(&mut self, diamond: Diamond) {
        let lattice = &self.model.lattice;
        let mut values = BTreeMap::new();
        for half in 0..2 {
            let Some(vertices) = self.halves.remove(&(diamond, half)) else {
                continue;
            };
            for (point, value) in vertices {
                let other = values.insert(point, value);
                assert!(
                    other.is_none_or(|other| other == value),
                    "halves differ at {point:?}"
                );
            }
        }
        let matrix = lattice.matrix(diamond, &values);
        let coefficients = &self.model.diamonds[&diamond].coefficients;
        for (index, coefficient) in lattice.centre_indices().into_iter().zip(coefficients) {
            if lattice.is_predicted(diamond, index) {
                let prediction = predict(&matrix, index, lattice.cells, self.model.raster.range);
                let value = self.model.reconstruct(prediction, *coefficient);
                values.insert(lattice.centre(diamond, index), value);
            }
        }
        self.refined.insert(diamond);
        for child in lattice.children(diamond) {
            for half in 0..2 {
                if lattice.parents(child)[half] == Some(diamond) {
                    self.scatter(child, half, &values);
                }
            }
        }
    }

    fn scatter(&mut self, diamond: Diamond, half: usize, values: &BTreeMap<Point, i64>) {
        let lattice = &self.model.lattice;
        let indices = lattice.vertex_indices().into_iter();
        let inside = indices.filter(|index| lattice.half_has_vertex(diamond, half, *index));
        let points = inside.map(|index| lattice.vertex(diamond, index));
        let vertices = points.map(|point| (point, values[&point])).collect();
        self.halves.insert((diamond, half), vertices);
    }
}
