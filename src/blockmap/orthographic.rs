//! Parallel views of a block.

use glam::{Mat4, Vec3, Vec4};

/// A view from infinitely far, in the coordinates of [`Local`](super::surroundings::Local).
pub struct Orthographic {
    right: Vec3,
    up: Vec3,
    /// Towards the eye.
    pub towards: Vec3,
    /// Middle and half size of what is seen, along `right` and `up`.
    window: [[f32; 2]; 2],
    /// Along `towards`, of the nearest corner.
    nearest: f32,
}

impl Orthographic {
    /// Of a box, seen whole.
    pub fn new(towards: Vec3, low: Vec3, high: Vec3) -> Orthographic {
        let right = Vec3::Z.cross(towards).try_normalize().unwrap_or(Vec3::X);
        let up = towards.cross(right);
        let corners = (0..8).map(|number| {
            let pick = |axis: usize| {
                if number >> axis & 1 == 0 {
                    low[axis]
                } else {
                    high[axis]
                }
            };
            Vec3::new(pick(0), pick(1), pick(2))
        });
        let range = |axis: Vec3| {
            let along = corners.clone().map(|corner| corner.dot(axis));
            along.fold([f32::INFINITY, f32::NEG_INFINITY], |[least, most], at| {
                [least.min(at), most.max(at)]
            })
        };
        let window = [right, up].map(|axis| {
            let [least, most] = range(axis);
            [0.5 * (least + most), (0.5 * (most - least)).max(1e-3)]
        });
        Orthographic {
            right,
            up,
            towards,
            window,
            nearest: range(towards)[1],
        }
    }

    /// To clip coordinates, whose z is the distance away from the eye.
    pub fn to_clip(&self) -> Mat4 {
        let [[across, width], [along, height]] = self.window;
        let row = |axis: Vec3, middle: f32, half: f32| (axis / half).extend(-middle / half);
        Mat4::from_cols(
            row(self.right, across, width),
            row(self.up, along, height),
            (-self.towards).extend(0.0),
            Vec4::W,
        )
        .transpose()
    }

    /// A place before the box on the line that a pixel's middle sees.
    pub fn eye(&self, [column, row]: [usize; 2], size: usize) -> Vec3 {
        let place = |[middle, half]: [f32; 2], pixel: usize| {
            middle + half * ((pixel as f32 + 0.5) / size as f32 * 2.0 - 1.0)
        };
        self.right * place(self.window[0], column)
            + self.up * place(self.window[1], row)
            + self.towards * (self.nearest + 1.0)
    }

    /// How near a place is, and the pixel that sees it; `None` outside the picture.
    pub fn see(&self, place: Vec3, size: usize) -> Option<([usize; 2], f32)> {
        let pixel = |axis: Vec3, [middle, half]: [f32; 2]| {
            ((place.dot(axis) - middle) / half + 1.0) * 0.5 * size as f32
        };
        let (x, y) = (
            pixel(self.right, self.window[0]),
            pixel(self.up, self.window[1]),
        );
        let inside = 0.0..size as f32;
        (inside.contains(&x) && inside.contains(&y))
            .then(|| ([x as usize, y as usize], place.dot(self.towards)))
    }
}

/// Cosine and sine of the golden angle, pi (3 - sqrt 5).
const GOLDEN_TURN: [f64; 2] = [-0.737_368_878_078_319_6, 0.675_490_294_261_523_8];

/// Evenly distributed directions of the upper hemisphere (Fibonacci lattice), the same on every machine: sums, products and square
/// roots only.
pub fn hemisphere(count: usize) -> impl Iterator<Item = Vec3> {
    let [cosine, sine] = GOLDEN_TURN;
    let turn = move |[x, y]: &[f64; 2]| Some([x * cosine - y * sine, x * sine + y * cosine]);
    let around = std::iter::successors(Some([1.0, 0.0]), turn);
    around.take(count).enumerate().map(move |(index, [x, y])| {
        let z = 1.0 - (index as f64 + 0.5) / count as f64;
        let flat = (1.0 - z * z).sqrt();
        Vec3::from([flat * x, flat * y, z].map(|along| along as f32))
    })
}
