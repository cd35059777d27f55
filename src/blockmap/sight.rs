//! Whether a node of a city is seen, and how large its error looks.

use super::tree::{Node, Tree};
use crate::geo::View;
use crate::{Error, Result};

/// The colours' error, of 255, at which a texel counts as wrong as a whole.
const WRONG_COLOUR: f32 = 16.0;

/// A view made ready to judge boxes.
pub struct Sight {
    /// Rows x, y and w of the matrix.
    rows: [[f64; 4]; 3],
    /// Pixels that a metre at w = 1 takes at most.
    scale: f64,
}

impl Node {
    /// How far the node is from the finest, in metres: as far as a height is off, or a texel where its colour is wrong.
    pub fn error_metres(&self, texel: f64) -> f64 {
        let wrong = f64::from((self.error.colour / WRONG_COLOUR).min(1.0));
        f64::from(self.error.height).max(texel * wrong)
    }
}

impl Sight {
    /// # Errors
    ///
    /// [`Error::Argument`] for numbers that are not finite, a viewport without an area, a negative tolerance, and a matrix that maps
    /// all to one point.
    pub fn new(view: &View) -> Result<Sight> {
        let wrong = |message: &str| Err(Error::Argument(message.to_owned()));
        let numbers = view
            .eye
            .iter()
            .chain(&view.world_to_clip)
            .chain(&view.viewport);
        if !numbers
            .chain([&view.tolerance])
            .all(|number| number.is_finite())
        {
            return wrong("a view has a number that is not finite");
        }
        if view.viewport.iter().any(|&size| size <= 0.0) {
            return wrong("a viewport has no area");
        }
        if view.tolerance < 0.0 {
            return wrong("a tolerance is below 0");
        }
        let m = &view.world_to_clip;
        let rows = [0, 1, 3].map(|row| [m[row], m[row + 4], m[row + 8], m[row + 12]]);
        let length = |row: &[f64; 4]| row[..3].iter().map(|n| n * n).sum::<f64>().sqrt();
        let scale = [0, 1].map(|axis| 0.5 * view.viewport[axis] * length(&rows[axis]));
        let scale = scale[0].max(scale[1]);
        if scale == 0.0 {
            return wrong("a view's matrix sees nothing");
        }
        Ok(Sight { rows, scale })
    }

    /// Whether a node, made so many sides wider on each side, meets the frustum or cannot be told to be outside.
    pub fn sees(&self, tree: &Tree, node: u32, wider: f64) -> bool {
        let mut inside = [false; 5];
        for corner in corners(tree, node, wider) {
            let [x, y, w] = self.to_clip(corner);
            inside[0] |= w > 0.0;
            inside[1] |= x <= w;
            inside[2] |= -x <= w;
            inside[3] |= y <= w;
            inside[4] |= -y <= w;
        }
        inside == [true; 5]
    }

    /// The node's error on the screen in pixels, if all of it were as near as its nearest corner; infinite where that is not
    /// in front of the eye.
    pub fn pixels(&self, tree: &Tree, node: u32) -> f64 {
        let found = &tree.nodes[node as usize];
        let (_, side) = tree.square(found);
        let error = found.error_metres(side / tree.side_texels as f64);
        if error == 0.0 {
            return 0.0;
        }
        let nearest = corners(tree, node, 0.0)
            .map(|corner| self.to_clip(corner)[2])
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        if nearest > 0.0 {
            error * self.scale / nearest
        } else {
            f64::INFINITY
        }
    }

    fn to_clip(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.rows
            .map(|row| row[0] * x + row[1] * y + row[2] * z + row[3])
    }
}

/// The corners of a node's box, from the floor of the city to its own top.
fn corners(tree: &Tree, node: u32, wider: f64) -> [[f64; 3]; 8] {
    let node = &tree.nodes[node as usize];
    let (corner, side) = tree.square(node);
    let z = [tree.floor, f64::from(node.heights[1])];
    std::array::from_fn(|number| {
        let end = |axis: usize| {
            let far = number >> axis & 1 == 1;
            corner[axis]
                + if far {
                    side * (1.0 + wider)
                } else {
                    -side * wider
                }
        };
        [end(0), end(1), z[number >> 2]]
    })
}
