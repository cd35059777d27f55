//! Hits of rays against those of every triangle of the raster, by another formula.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use crate::support::repositories::repository;
use kimberlite::build::BuildOptions;
use kimberlite::cut::{DiamondSource, Query, Ray};
use kimberlite::lattice::Lattice;

const SIDE: u32 = 257;
/// In cells, and in world units: where rounding may put a ray on either side of an edge.
const MARGIN: f64 = 1e-9;

type Vector = [f64; 3];

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The drawn triangles of the leaf level, in columns, rows and metres.
fn triangles(source: &MemorySource, lattice: &Lattice) -> Vec<[Vector; 3]> {
    let mut all = Vec::new();
    for row in 0..i64::from(SIDE) - 1 {
        for column in 0..i64::from(SIDE) - 1 {
            let corners = match lattice.has_main_leaf_cell([column, row]) {
                true => [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]],
                false => [[(0, 0), (1, 0), (0, 1)], [(1, 0), (1, 1), (0, 1)]],
            };
            for triangle in corners {
                let places = triangle.map(|(i, j)| [column + i, row + j]);
                let vertex = |at: [i64; 2]| Some([at[0] as f64, at[1] as f64, height(source, at)?]);
                if let [Some(a), Some(b), Some(c)] = places.map(vertex) {
                    all.push([a, b, c]);
                }
            }
        }
    }
    all
}

fn height(source: &MemorySource, at: [i64; 2]) -> Option<f64> {
    let [offset, scale] = source.height_to_world();
    Some(offset + scale * f64::from(source.raster.at(at)?))
}

/// A ray from one place to another and beyond, in columns, rows and metres.
#[derive(Clone, Copy, Debug)]
struct Line {
    from: Vector,
    along: Vector,
    longest: f64,
}

impl Line {
    fn at(&self, t: f64) -> Vector {
        [0, 1, 2].map(|axis| self.from[axis] + t * self.along[axis])
    }
}

/// Where a line comes at least near a triangle (Möller and Trumbore).
struct Touch {
    from: f64,
    to: f64,
    /// By how much rounding may move it.
    margin: f64,
    /// From above 1, from below -1, along it 0.
    facing: i32,
}

fn touch(line: &Line, [a, b, c]: &[Vector; 3]) -> Option<Touch> {
    let (u, v, s) = (minus(*b, *a), minus(*c, *a), minus(line.from, *a));
    let p = cross(line.along, v);
    let area = dot(u, p);
    let normal = cross(u, v);
    let sizes = dot(normal, normal).sqrt() * dot(line.along, line.along).sqrt();
    if area.abs() < 1e-12 * sizes {
        let off = dot(s, normal).abs() / dot(normal, normal).sqrt();
        return (off < 1e-6).then(|| along(line, &[*a, *b, *c])).flatten();
    }
    let q = cross(s, u);
    let (beta, gamma, t) = (
        dot(s, p) / area,
        dot(line.along, q) / area,
        dot(v, q) / area,
    );
    let slack = MARGIN * (1.0 + sizes / area.abs());
    let is_near = beta >= -slack && gamma >= -slack && beta + gamma <= 1.0 + slack;
    let length = dot(line.along, line.along).sqrt();
    let margin = MARGIN * (t.abs() + (1.0 + dot(s, s).sqrt()) / length * (sizes / area.abs()));
    let facing = if area > 0.0 { 1 } else { -1 };
    (is_near && t >= -margin && t <= line.longest + margin).then_some(Touch {
        from: t,
        to: t,
        margin,
        facing,
    })
}

/// The part of a line in the plane of a triangle that is over the bounds of it.
fn along(line: &Line, corners: &[Vector; 3]) -> Option<Touch> {
    let [mut from, mut to] = [0.0, line.longest];
    for axis in 0..2 {
        let ends = corners.map(|corner| corner[axis]);
        let low = ends.iter().copied().fold(f64::INFINITY, f64::min) - MARGIN;
        let high = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max) + MARGIN;
        if line.along[axis] == 0.0 {
            if !(low..=high).contains(&line.from[axis]) {
                return None;
            }
            continue;
        }
        let ends = [low, high].map(|end| (end - line.from[axis]) / line.along[axis]);
        from = ends[0].min(ends[1]).max(from);
        to = ends[0].max(ends[1]).min(to);
    }
    (from <= to).then_some(Touch {
        from,
        to,
        margin: 1e-6 * (1.0 + to),
        facing: 0,
    })
}

/// Whether a place is so far from voids and the border that a ray cannot pass beside the surface there.
fn is_inner(source: &MemorySource, place: Vector) -> bool {
    let [column, row] = [place[0], place[1]].map(|along| along.floor() as i64);
    let around = (-1..=2).flat_map(|j| (-1..=2).map(move |i| [column + i, row + j]));
    around.into_iter().all(|at| source.raster.at(at).is_some())
}

/// Fails unless the query's hit is where the triangles say: at a place that the line only touches, or at the first
/// where it passes from one side of them to the other.
fn check(source: &MemorySource, all: &[[Vector; 3]], query: &mut Query, line: Line) -> bool {
    let (frame, [from, along]) = (source.frame(), [line.from, line.along]);
    let [x, y] = frame.grid_to_world(from[0], from[1]);
    let ray = Ray {
        origin: [x, y, from[2]],
        direction: [along[0] * frame.step[0], along[1] * frame.step[1], along[2]],
        longest: line.longest,
    };
    let hit = query.ray_intersect(&ray).unwrap();
    let mut touches: Vec<Touch> = all
        .iter()
        .filter_map(|triangle| touch(&line, triangle))
        .collect();
    touches.sort_by(|a, b| a.from.total_cmp(&b.from));
    let mut rest = &touches[..];
    while let Some(first) = rest.first() {
        let (mut end, mut count, mut margin) = (first.to, 0, first.margin);
        while count < rest.len() && rest[count].from <= end + margin + rest[count].margin {
            end = end.max(rest[count].to);
            margin = margin.max(rest[count].margin);
            count += 1;
        }
        let (cluster, others) = rest.split_at(count);
        if hit.is_some_and(|hit| (first.from - margin..=end + margin).contains(&hit.distance)) {
            return true;
        }
        let passes = cluster.iter().all(|touch| touch.facing == first.facing) && first.facing != 0;
        let is_within = first.from > margin && end + margin < line.longest;
        if passes && is_within && is_inner(source, line.at(first.from)) {
            panic!(
                "{line:?} meets the surface at {}, not at {hit:?}",
                first.from
            );
        }
        rest = others;
    }
    assert!(hit.is_none(), "{line:?} meets nothing at {hit:?}");
    false
}

struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From `low` to `high`.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn sample(&mut self) -> [i64; 2] {
        [0, 1].map(|_| (self.next() % u64::from(SIDE)) as i64)
    }
}

/// The `kind`-th of nine ways to aim a ray.
fn aimed(kind: usize, source: &MemorySource, numbers: &mut Numbers) -> Line {
    let last = f64::from(SIDE - 1);
    let on = |at: [i64; 2], above: f64| {
        let ground = height(source, at).unwrap_or(0.0);
        [at[0] as f64, at[1] as f64, ground + above]
    };
    let anywhere = |numbers: &mut Numbers, margin: f64, heights: [f64; 2]| {
        let [x, y] = [0, 1].map(|_| numbers.between(-margin, last + margin));
        [x, y, numbers.between(heights[0], heights[1])]
    };
    let samples = [numbers.sample(), numbers.sample()];
    let near = numbers.between(-0.5, 0.5);
    let level = on(samples[0], 0.0)[2];
    let turned = (numbers.next() % 8) as usize;
    let steps = [
        (1, 0),
        (0, 1),
        (1, 1),
        (1, -1),
        (-1, 0),
        (0, -1),
        (-1, -1),
        (-1, 1),
    ];
    let step = [steps[turned].0, steps[turned].1].map(f64::from);
    let (from, to) = match kind {
        // From above to the ground, from vertex to vertex, grazing what is between, from beside and from below.
        0 => (
            anywhere(numbers, 0.0, [500.0, 4000.0]),
            anywhere(numbers, 0.0, [-300.0, 300.0]),
        ),
        1 => (on(samples[0], 0.0), on(samples[1], 0.0)),
        2 => (on(samples[0], near), on(samples[1], 1e-6)),
        3 => (
            anywhere(numbers, 300.0, [-400.0, 600.0]),
            anywhere(numbers, 0.0, [-400.0, 600.0]),
        ),
        4 => (
            anywhere(numbers, 0.0, [-4000.0, -500.0]),
            on(samples[0], 0.0),
        ),
        // Along rows, columns and diagonals through samples, at a sample's height, above or below it, or falling.
        5 => (on(samples[0], 0.0), [step[0], step[1], 0.0]),
        6 => (on(samples[0], near * 100.0), [step[0], step[1], near]),
        7 => (
            [
                -5.0 * step[0] + samples[0][0] as f64,
                samples[0][1] as f64,
                level,
            ],
            [step[0], step[1], 0.0],
        ),
        // Straight down on vertices, edges and between.
        _ => {
            let [x, y, _] = on(samples[0], 0.0);
            let beside = [near, 0.0][turned % 2];
            ([(x + beside).clamp(0.0, last), y, 9000.0], [0.0, 0.0, -1.0])
        }
    };
    let along = if (5..9).contains(&kind) {
        to
    } else {
        minus(to, from)
    };
    let longest = if numbers.next().is_multiple_of(3) && kind < 5 {
        1.0
    } else {
        f64::INFINITY
    };
    Line {
        from,
        along,
        longest,
    }
}

/// 2,000 rays; with KIMBERLITE_SOAK 100,000.
#[test]
fn rays_meet_the_triangle_that_all_triangles_say() {
    let soak = std::env::var_os("KIMBERLITE_SOAK").is_some();
    let count = if soak { 100_000 } else { 2_000 };
    let mut numbers = Numbers(11);
    for (voids, cells_log2) in [
        (Voids::None, 5),
        (Voids::Blob, 4),
        (Voids::Sparse, 4),
        (Voids::None, 6),
    ] {
        let source = MemorySource::rough(hills(SIDE, SIDE, 3, voids), cells_log2, 0.0);
        let options = BuildOptions {
            max_error: 0.0,
            cells_log2,
            threads: 1,
            ..BuildOptions::default()
        };
        let terrain = repository(&source, &options);
        let all = triangles(&source, terrain.lattice());
        let mut query = Query::new(terrain, 1 << 20);
        let lines = (0..count / 4).map(|index| aimed(index % 9, &source, &mut numbers));
        let lines: Vec<Line> = lines.filter(|line| line.along != [0.0; 3]).collect();
        let met = lines
            .iter()
            .filter(|line| check(&source, &all, &mut query, **line))
            .count();
        assert!(
            met * 3 > lines.len(),
            "{met} of {} rays met anything",
            lines.len()
        );
    }
}
