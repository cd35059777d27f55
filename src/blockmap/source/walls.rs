//! Windows on the walls of one object: walls in one plane that touch are one wall, and no window is cut at its ends.

use std::ops::Range;

use glam::DVec3;

use crate::blockmap::facade;
use crate::blockmap::{Paint, Triangle};

/// Metres, about: of a window with the wall around it.
const BAY: f64 = 2.5;
/// Metres, about.
const STOREY: f64 = 3.0;
/// Metres: a wall that is narrower or lower has no windows.
const LEAST: [f64; 2] = [1.0, 1.8];
/// Metres: corners so near to a plane are in it, and walls so near to each other touch.
const TOLERANCE: f64 = 0.05;
/// Cosine of the angle between normals that are of one plane.
const PARALLEL: f64 = 0.9995;
/// A wall is looked for in so many planes, the last ones, so that the time grows with the number of walls.
const PLANES: usize = 64;

/// A wall's triangles, which lie in one plane.
pub(super) struct Wall {
    pub triangles: Range<usize>,
    /// Unit; not vertical.
    pub normal: DVec3,
}

struct Plane {
    normal: DVec3,
    /// Horizontal unit vector, to the right for who looks at the wall.
    along: DVec3,
    offset: f64,
    /// Of the walls in it.
    spans: Vec<Span>,
}

/// A wall from its left to its right end.
#[derive(Clone)]
struct Span {
    ends: [f64; 2],
    heights: [f64; 2],
    walls: Vec<usize>,
}

/// Paints an object's walls with the facade of `seed`.
pub(super) fn paint(triangles: &mut [Triangle], walls: &[Wall], seed: u32) {
    let Some(origin) = walls
        .first()
        .and_then(|wall| triangles.get(wall.triangles.start))
        .map(|triangle| DVec3::from_array(triangle.corners[0]))
    else {
        return;
    };
    for plane in &mut planes(triangles, walls, origin) {
        plane.join();
        for span in &plane.spans {
            for wall in span.walls.iter().filter_map(|&wall| walls.get(wall)) {
                for triangle in &mut triangles[wall.triangles.clone()] {
                    triangle.paint = span.paint(triangle, plane.along, origin, seed);
                }
            }
        }
    }
}

fn planes(triangles: &[Triangle], walls: &[Wall], origin: DVec3) -> Vec<Plane> {
    let mut planes: Vec<Plane> = Vec::new();
    for (number, wall) in walls.iter().enumerate() {
        let corners: Vec<DVec3> = triangles[wall.triangles.clone()]
            .iter()
            .flat_map(|triangle| triangle.corners)
            .map(|corner| DVec3::from_array(corner) - origin)
            .collect();
        let known = planes
            .iter()
            .enumerate()
            .rev()
            .take(PLANES)
            .find(|(_, plane)| plane.holds(wall.normal, &corners))
            .map(|(place, _)| place);
        let place = match known {
            Some(place) => place,
            None => {
                planes.push(Plane::new(wall.normal, &corners));
                planes.len() - 1
            }
        };
        planes[place].add(number, &corners);
    }
    planes
}

impl Plane {
    fn new(normal: DVec3, corners: &[DVec3]) -> Plane {
        Plane {
            normal,
            along: DVec3::new(-normal.y, normal.x, 0.0).normalize_or(DVec3::X),
            offset: corners.first().map_or(0.0, |corner| corner.dot(normal)),
            spans: Vec::new(),
        }
    }

    fn holds(&self, normal: DVec3, corners: &[DVec3]) -> bool {
        self.normal.dot(normal) >= PARALLEL
            && corners
                .iter()
                .all(|corner| (corner.dot(self.normal) - self.offset).abs() <= TOLERANCE)
    }

    fn add(&mut self, wall: usize, corners: &[DVec3]) {
        let empty = [f64::INFINITY, f64::NEG_INFINITY];
        let range = |[low, high]: [f64; 2], at: f64| [low.min(at), high.max(at)];
        self.spans.push(Span {
            ends: corners
                .iter()
                .map(|corner| corner.dot(self.along))
                .fold(empty, range),
            heights: corners.iter().map(|corner| corner.z).fold(empty, range),
            walls: vec![wall],
        });
    }

    /// Makes one span of those that touch.
    fn join(&mut self) {
        self.spans.sort_by(|a, b| a.ends[0].total_cmp(&b.ends[0]));
        let mut joined: Vec<Span> = Vec::new();
        for span in self.spans.drain(..) {
            match joined.last_mut() {
                Some(last) if span.ends[0] <= last.ends[1] + TOLERANCE => {
                    last.ends[1] = last.ends[1].max(span.ends[1]);
                    last.heights = [
                        last.heights[0].min(span.heights[0]),
                        last.heights[1].max(span.heights[1]),
                    ];
                    last.walls.extend(span.walls);
                }
                _ => joined.push(span),
            }
        }
        self.spans = joined;
    }
}

impl Span {
    fn paint(&self, triangle: &Triangle, along: DVec3, origin: DVec3, seed: u32) -> Paint {
        let size = [
            self.ends[1] - self.ends[0],
            self.heights[1] - self.heights[0],
        ];
        if size[0] < LEAST[0] || size[1] < LEAST[1] {
            return Paint::Plain(facade::wall(seed));
        }
        let count = divisions(size);
        let at = triangle.corners.map(|corner| {
            let corner = DVec3::from_array(corner) - origin;
            let share = [
                (corner.dot(along) - self.ends[0]) / size[0],
                (corner.z - self.heights[0]) / size[1],
            ];
            [0, 1].map(|axis| (share[axis].clamp(0.0, 1.0) * count[axis]) as f32)
        });
        Paint::Facade { seed, at }
    }
}

/// Windows along, and storeys of, a wall of this width and height in metres.
pub(super) fn divisions([width, height]: [f64; 2]) -> [f64; 2] {
    [
        (width / BAY).round().max(1.0),
        (height / STOREY).round().max(1.0),
    ]
}
