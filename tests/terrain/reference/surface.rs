//! What is drawn of a diamond, and how far it is from the leaf surface.
//!
//! Every triangle of every level is a union of *atoms*: the quarters into which its two diagonals cut
//! the square between four samples. An atom is named by a point well inside it.

use std::collections::{BTreeMap, BTreeSet};

use super::lattice::{Diamond, Lattice, Point, overlap};
use super::model::Model;

impl Model {
    /// The triangles that are drawn of a half of a diamond, if it is present.
    pub fn drawn(&self, diamond: Diamond, half: usize) -> Vec<[Point; 3]> {
        let lattice = &self.lattice;
        let leaf = diamond.level == lattice.leaf_level();
        let mut triangles = lattice.triangles(diamond, half);
        triangles.retain(|triangle| {
            let mut valid = triangle.iter().map(|point| self.input(*point).is_some());
            let ground = if leaf {
                valid.all(|valid| valid)
            } else {
                let outside = |point: &Point| lattice.sample(*point).is_none();
                valid.any(|valid| valid) || triangle.iter().all(outside)
            };
            ground && overlap(triangle, &lattice.domain())
        });
        if lattice.present(diamond)[half] {
            triangles
        } else {
            Vec::new()
        }
    }

    /// The atoms of the domain that have ground: those of the triangles drawn at the leaf level.
    pub fn ground(&self) -> BTreeSet<Point> {
        let leaves = self.lattice.level(self.lattice.leaf_level());
        leaves
            .into_iter()
            .flat_map(|leaf| self.drawn_atoms(leaf))
            .collect()
    }

    fn drawn_atoms(&self, diamond: Diamond) -> BTreeSet<Point> {
        let triangles = (0..2).flat_map(|half| self.drawn(diamond, half));
        triangles
            .flat_map(|triangle| self.lattice.atoms(&triangle))
            .collect()
    }

    /// The stored error of every diamond, before it is rounded.
    pub fn errors(&self) -> BTreeMap<Diamond, f64> {
        let ground = self.ground();
        let mut errors = BTreeMap::new();
        for diamond in self.lattice.diamonds().into_iter().rev() {
            let own = if diamond.level == self.lattice.leaf_level() {
                0.0
            } else {
                self.own_error(diamond, &ground)
            };
            let children = self.lattice.children(diamond);
            let error = children
                .iter()
                .map(|child| errors[child])
                .fold(own, f64::max);
            errors.insert(diamond, error);
        }
        errors
    }

    /// A diamond's error against the leaf surface, without its children's; infinite where it
    /// covers a void or leaves ground uncovered.
    pub fn own_error(&self, diamond: Diamond, ground: &BTreeSet<Point>) -> f64 {
        let lattice = &self.lattice;
        let covered = self.drawn_atoms(diamond);
        let mut atoms = (0..2)
            .filter(|half| lattice.present(diamond)[*half])
            .flat_map(|half| lattice.triangles(diamond, half))
            .flat_map(|triangle| lattice.atoms(&triangle));
        if atoms.any(|atom| covered.contains(&atom) != ground.contains(&atom)) {
            return f64::INFINITY;
        }
        let triangles = (0..2).flat_map(|half| self.drawn(diamond, half));
        triangles
            .map(|triangle| self.distance(&triangle))
            .fold(0.0, f64::max)
    }

    /// The largest distance between a triangle and the leaf level: at that one's valid vertices in it, or in the middles of
    /// its edges there, where edges of the two may cross.
    pub fn distance(&self, triangle: &[Point; 3]) -> f64 {
        let heights = triangle.map(|point| self.values[&point]);
        let points = self.lattice.samples_around(triangle).into_iter();
        let vertices = points.clone().map(|point| [point, point]);
        vertices
            .chain(points.filter_map(|point| self.leaf_diagonal(point)))
            .filter(|ends| ends.iter().all(|end| self.input(*end).is_some()))
            .filter_map(|[a, b]| {
                let middle = ((a.0 + b.0) / 2, (a.1 + b.1) / 2);
                let height = height_in(triangle, heights, middle)?;
                let leaf = (self.values[&a] + self.values[&b]) as f64 / 2.0;
                Some((height - leaf).abs())
            })
            .fold(0.0, f64::max)
    }

    /// The ends of the diagonal by which the leaf level splits the cell right of and below a sample; `None` beyond the
    /// last ones.
    fn leaf_diagonal(&self, (x, y): Point) -> Option<[Point; 2]> {
        let lattice = &self.lattice;
        let step = lattice.spacing();
        let (column, row) = (x / step, y / step);
        if column + 1 >= lattice.width || row + 1 >= lattice.height {
            return None;
        }
        let block = |place: i64| place / lattice.cells;
        Some(match (block(column) + block(row)) % 2 {
            0 => [(x, y), (x + step, y + step)],
            _ => [(x + step, y), (x, y + step)],
        })
    }
}

impl Lattice {
    /// The samples' positions in the box around a triangle, without what lies outside the domain.
    pub fn samples_around(&self, triangle: &[Point; 3]) -> Vec<Point> {
        let range = |coordinates: [i64; 3], samples: i64| {
            let low = coordinates
                .into_iter()
                .min()
                .unwrap_or(0)
                .div_euclid(self.spacing());
            let high = coordinates
                .into_iter()
                .max()
                .unwrap_or(0)
                .div_euclid(self.spacing());
            low.max(0)..=high.min(samples - 1)
        };
        let columns = range(triangle.map(|point| point.0), self.width);
        let rows = range(triangle.map(|point| point.1), self.height);
        rows.flat_map(|row| columns.clone().map(move |column| (column, row)))
            .map(|(column, row)| self.point(column, row))
            .collect()
    }

    /// The atoms of the domain that make up a triangle.
    pub fn atoms(&self, triangle: &[Point; 3]) -> Vec<Point> {
        let (quarter, half) = (self.spacing() / 4, self.spacing() / 2);
        let [_, _, (right, bottom), _] = self.domain();
        self.samples_around(triangle)
            .into_iter()
            .filter(|(x, y)| *x < right && *y < bottom)
            .flat_map(|(x, y)| {
                let (far_x, far_y) = (x + 3 * quarter, y + 3 * quarter);
                [
                    (x + half, y + quarter),
                    (x + half, far_y),
                    (x + quarter, y + half),
                    (far_x, y + half),
                ]
            })
            .filter(|atom| weights(triangle, *atom).is_some())
            .collect()
    }
}

/// Height of a triangle at a point of it, or `None` if it lies elsewhere. Exact: the weights'
/// denominators are powers of two.
pub fn height_in(triangle: &[Point; 3], heights: [i64; 3], point: Point) -> Option<f64> {
    let weights = weights(triangle, point)?;
    let total: i128 = weights.iter().sum();
    let sum: i128 = weights
        .iter()
        .zip(heights)
        .map(|(weight, z)| weight * i128::from(z))
        .sum();
    Some(sum as f64 / total as f64)
}

/// The three weights of a point of a closed triangle, up to a factor; `None` if it lies elsewhere.
fn weights(triangle: &[Point; 3], point: Point) -> Option<[i128; 3]> {
    let [a, b, c] = *triangle;
    let sign = cross(a, b, c).signum();
    let weights =
        [cross(point, b, c), cross(a, point, c), cross(a, b, point)].map(|area| area * sign);
    weights.iter().all(|weight| *weight >= 0).then_some(weights)
}

/// Twice the signed area of a triangle.
fn cross(a: Point, b: Point, c: Point) -> i128 {
    let (abx, aby) = (i128::from(b.0 - a.0), i128::from(b.1 - a.1));
    let (acx, acy) = (i128::from(c.0 - a.0), i128::from(c.1 - a.1));
    abx * acy - aby * acx
}
