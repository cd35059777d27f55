//! Which triangle is seen at each pixel of a view.

use glam::{Mat4, Vec3, Vec4};

/// No triangle.
pub const NOTHING: u32 = u32::MAX;
/// Least w of what is in front of a perspective eye.
const NEAR: f32 = 1e-3;

/// A depth buffer, and whose the depths are. Pixel (0, 0) is at clip coordinates (-1, -1).
pub struct Seen {
    width: usize,
    height: usize,
    /// Linear on the screen, greater is nearer.
    nearness: Vec<f32>,
    triangles: Vec<u32>,
    /// The nearness of a vertex at this clip position.
    nearness_of: fn(Vec4) -> f32,
}

impl Seen {
    /// An empty view. With `is_perspective` w is the distance along the view, otherwise it is 1 and z the distance.
    pub fn new([width, height]: [usize; 2], is_perspective: bool) -> Seen {
        Seen {
            width,
            height,
            nearness: vec![f32::NEG_INFINITY; width * height],
            triangles: vec![NOTHING; width * height],
            nearness_of: if is_perspective {
                |clip| 1.0 / clip.w
            } else {
                |clip| -clip.z
            },
        }
    }

    /// Forgets all triangles.
    pub fn clear(&mut self) {
        self.nearness.fill(f32::NEG_INFINITY);
        self.triangles.fill(NOTHING);
    }

    /// The triangle at a pixel, or [`NOTHING`].
    pub fn triangle(&self, column: usize, row: usize) -> u32 {
        self.triangles[row * self.width + column]
    }

    /// The nearness at a pixel; minus infinity where there is no triangle.
    pub fn nearness(&self, column: usize, row: usize) -> f32 {
        self.nearness[row * self.width + column]
    }

    /// Draws a triangle under a number where it is the nearest, from both sides. Triangles that share an edge leave no pixel
    /// between them.
    pub fn draw(&mut self, world_to_clip: &Mat4, corners: &[Vec3; 3], number: u32) {
        let clip = corners.map(|corner| to_clip(world_to_clip, corner));
        if clip.iter().all(|corner| corner.w >= NEAR) {
            return self.fill(clip, number);
        }
        // The part in front of the eye has three or four corners.
        let mut front: [Vec4; 4] = [Vec4::ZERO; 4];
        let mut count = 0;
        for index in 0..3 {
            let (from, to) = (clip[index], clip[(index + 1) % 3]);
            let mut add = |corner| {
                front[count] = corner;
                count += 1;
            };
            if from.w >= NEAR {
                add(from);
            }
            if (from.w >= NEAR) != (to.w >= NEAR) {
                add(from + (to - from) * ((NEAR - from.w) / (to.w - from.w)));
            }
        }
        for last in 2..count {
            self.fill([front[0], front[last - 1], front[last]], number);
        }
    }

    fn fill(&mut self, clip: [Vec4; 3], number: u32) {
        let size = [self.width as f32, self.height as f32];
        let corners = clip.map(|corner| {
            let at = [corner.x, corner.y].map(|along| (along / corner.w + 1.0) * 0.5);
            [at[0] * size[0], at[1] * size[1]]
        });
        let area = edge(corners[0], corners[1]).at(corners[2]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let flip = area.signum();
        let edges = [0, 1, 2].map(|index| {
            let edge = edge(corners[(index + 1) % 3], corners[(index + 2) % 3]);
            edge.scaled(flip)
        });
        let nearness = clip.map(self.nearness_of);
        self.fill_inside((corners, number), edges, nearness, area.abs());
    }

    /// Draws where all edges are positive; `nearness` is that of the corners.
    fn fill_inside(
        &mut self,
        (corners, number): ([[f32; 2]; 3], u32),
        edges: [Edge; 3],
        nearness: [f32; 3],
        area: f32,
    ) {
        let weigh = |part: fn(&Edge) -> f32| {
            let parts = (0..3).map(|index| part(&edges[index]) * nearness[index]);
            parts.sum::<f32>() / area
        };
        let plane = Edge {
            across: weigh(|edge| edge.across),
            down: weigh(|edge| edge.down),
            constant: weigh(|edge| edge.constant),
        };
        let (low, high) = (
            nearness.into_iter().fold(f32::INFINITY, f32::min),
            nearness.into_iter().fold(f32::NEG_INFINITY, f32::max),
        );
        // Pixels whose centres are in the box around the triangle.
        let range = |axis: usize, end: usize| {
            let along = corners.map(|corner| corner[axis]);
            let least = along.into_iter().fold(f32::INFINITY, f32::min) - 0.5;
            let most = along.into_iter().fold(f32::NEG_INFINITY, f32::max) - 0.5;
            (least.ceil().max(0.0) as usize)..((most.floor() + 1.0).clamp(0.0, end as f32) as usize)
        };
        let (columns, rows) = (range(0, self.width), range(1, self.height));
        for row in rows {
            let y = row as f32 + 0.5;
            let begin = edges.map(|edge| edge.down * y + edge.constant);
            let depth = plane.down * y + plane.constant;
            let first = row * self.width;
            for column in columns.clone() {
                let x = column as f32 + 0.5;
                let is_inside = (0..3).all(|index| edges[index].across * x + begin[index] >= 0.0);
                if !is_inside {
                    continue;
                }
                let depth = (plane.across * x + depth).clamp(low, high);
                if depth > self.nearness[first + column] {
                    self.nearness[first + column] = depth;
                    self.triangles[first + column] = number;
                }
            }
        }
    }
}

/// In the order of operations that is written, on every machine.
fn to_clip(world_to_clip: &Mat4, corner: Vec3) -> Vec4 {
    let m = world_to_clip.to_cols_array();
    let row = |row: usize| {
        m[row] * corner.x + m[row + 4] * corner.y + m[row + 8] * corner.z + m[row + 12]
    };
    Vec4::new(row(0), row(1), row(2), row(3))
}

/// A linear function of a place on the screen.
#[derive(Clone, Copy)]
struct Edge {
    across: f32,
    down: f32,
    constant: f32,
}

/// Zero on the line through two points, positive on its left. That of the points exchanged is its exact negative.
fn edge(from: [f32; 2], to: [f32; 2]) -> Edge {
    let forward = |from: [f32; 2], to: [f32; 2]| {
        let (across, down) = (from[1] - to[1], to[0] - from[0]);
        Edge {
            across,
            down,
            constant: -(across * from[0] + down * from[1]),
        }
    };
    if from <= to {
        forward(from, to)
    } else {
        forward(to, from).scaled(-1.0)
    }
}

impl Edge {
    fn at(&self, [x, y]: [f32; 2]) -> f32 {
        self.across * x + (self.down * y + self.constant)
    }

    fn scaled(&self, factor: f32) -> Edge {
        Edge {
            across: factor * self.across,
            down: factor * self.down,
            constant: factor * self.constant,
        }
    }
}
