//! The triangles of a city, and what is painted on them.

use super::facade;

/// Coordinates and heights are smaller than this, in metres.
pub const FAR: f64 = 1e12;

/// Textured triangles in one metric reference system, x east, y north, z up. They may be open, overlap, repeat and
/// have no area.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// In any order.
    pub triangles: Vec<Triangle>,
    /// What [`Paint::Texture`] refers to.
    pub textures: Vec<Texture>,
    /// The reference system as `EPSG:n` or WKT, or empty.
    pub crs: String,
    /// What was left out or replaced while the city was read, one line each.
    pub warnings: Vec<String>,
}

/// Three corners, and the paint between them. Both sides are seen.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    /// In metres.
    pub corners: [[f64; 3]; 3],
    /// Its colour.
    pub paint: Paint,
}

/// The colour of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// The same everywhere.
    Plain([u8; 3]),
    /// A texture of the scene; `at` are its coordinates at the corners: 0, 0 is the image's lower left corner, 1, 1 its
    /// upper right one, and it repeats.
    Texture {
        /// Into the scene's textures.
        index: u32,
        /// At each corner.
        at: [[f32; 2]; 3],
    },
    /// A procedural facade ([`facade`]); `at` are its coordinates at the corners: windows along the wall, and storeys
    /// above the ground.
    Facade {
        /// Tells the facade of one building from that of another.
        seed: u32,
        /// At each corner.
        at: [[f32; 2]; 3],
    },
}

/// An image.
#[derive(Clone, Debug)]
pub struct Texture {
    width: u32,
    height: u32,
    /// Red, green, blue of each pixel; the first row is the uppermost.
    pixels: Vec<u8>,
}

impl Texture {
    /// An image of `3 * width * height` bytes; `None` where there are not as many, or none.
    pub fn new(width: u32, height: u32, pixels: Vec<u8>) -> Option<Texture> {
        let length = (width as usize)
            .checked_mul(height as usize)?
            .checked_mul(3)?;
        (length > 0 && pixels.len() == length).then_some(Texture {
            width,
            height,
            pixels,
        })
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.pixels.len()
    }

    /// The colour at texture coordinates, between the four nearest pixels.
    fn colour(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let axis = |along: f32, length: u32| {
            let turns = along - along.floor();
            let place = turns * length as f32 - 0.5;
            let low = place.floor();
            let wrapped = |at: f32| (at as i64).rem_euclid(i64::from(length)) as usize;
            (wrapped(low), wrapped(low + 1.0), place - low)
        };
        let (left, right, across) = axis(u, self.width);
        let (upper, lower, down) = axis(1.0 - v, self.height);
        let pixel = |row: usize, column: usize| {
            let first = 3 * (row * self.width as usize + column);
            [0, 1, 2].map(|band| f32::from(self.pixels[first + band]))
        };
        let mix = |a: [f32; 3], b: [f32; 3], share: f32| {
            [0, 1, 2].map(|band| a[band] + share * (b[band] - a[band]))
        };
        mix(
            mix(pixel(upper, left), pixel(upper, right), across),
            mix(pixel(lower, left), pixel(lower, right), across),
            down,
        )
    }
}

impl Triangle {
    /// Its unit normal by the right-hand rule; `None` without an area.
    pub fn normal(&self) -> Option<[f64; 3]> {
        let [a, b, c] = self.corners.map(glam::DVec3::from_array);
        (b - a)
            .cross(c - a)
            .try_normalize()
            .map(|normal| normal.to_array())
    }
}

impl Scene {
    /// The colour of a paint where the three corners have these weights.
    pub fn colour(&self, paint: &Paint, weights: [f32; 3]) -> [f32; 3] {
        let between = |at: &[[f32; 2]; 3]| {
            [0, 1].map(|axis| {
                (0..3)
                    .map(|corner| weights[corner] * at[corner][axis])
                    .sum()
            })
        };
        match paint {
            Paint::Plain(colour) => colour.map(f32::from),
            Paint::Texture { index, at } => match self.textures.get(*index as usize) {
                Some(texture) => texture.colour(between(at)),
                None => [128.0; 3],
            },
            Paint::Facade { seed, at } => facade::colour(*seed, between(at)),
        }
    }

    /// Takes over another scene's triangles and textures, its warnings, and its reference system if there is none.
    pub fn append(&mut self, other: Scene) {
        let first = self.textures.len() as u32;
        let moved = other.triangles.into_iter().map(|mut triangle| {
            if let Paint::Texture { index, .. } = &mut triangle.paint {
                *index += first;
            }
            triangle
        });
        self.triangles.extend(moved);
        self.textures.extend(other.textures);
        self.warnings.extend(other.warnings);
        if self.crs.is_empty() {
            self.crs = other.crs;
        }
    }

    /// The box around all corners; `None` without triangles.
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let mut corners = self.triangles.iter().flat_map(|triangle| triangle.corners);
        let first = corners.next()?;
        Some(corners.fold([first, first], |[low, high], corner| {
            [
                [0, 1, 2].map(|axis| low[axis].min(corner[axis])),
                [0, 1, 2].map(|axis| high[axis].max(corner[axis])),
            ]
        }))
    }
}
