//! Polygons with holes in space, and their triangles.

use earcut::Earcut;
use glam::DVec3;

/// Square metres; a polygon of no more is none.
const LEAST_AREA: f64 = 1e-9;
/// Of a polygon's area: triangles that differ by more come from one that crosses itself.
const MOST_DEVIATION: f64 = 0.01;

/// A corner of a polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    /// In metres.
    pub at: DVec3,
    /// Where the texture is met, 0, 0 in its lower left corner; anything without a texture.
    pub texture: [f32; 2],
}

/// What a polygon became.
pub(super) struct Triangles {
    /// Unit normal by the right-hand rule.
    pub normal: DVec3,
    /// Turned like the outer ring.
    pub triangles: Vec<[Corner; 3]>,
}

/// Turns polygons into triangles; keeps its memory between them.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    indices: Vec<usize>,
}

impl Triangulator {
    pub(super) fn new() -> Triangulator {
        Triangulator {
            earcut: Earcut::new(),
            indices: Vec::new(),
        }
    }

    /// The triangles of an outer ring and its holes, all closed without repeating their first corner; `None` where fewer
    /// than three corners differ, the area is zero or the outline crosses itself.
    pub(super) fn triangulate(&mut self, rings: &[Vec<Corner>]) -> Option<Triangles> {
        let mut rings = rings.iter().map(|ring| distinct(ring));
        let mut corners = rings.next().filter(|ring| ring.len() >= 3)?;
        let area_vector = newell(&corners);
        if area_vector.length() <= 2.0 * LEAST_AREA {
            return None;
        }
        let normal = area_vector.try_normalize()?;
        let mut starts = Vec::new();
        for hole in rings.filter(|ring| ring.len() >= 3) {
            starts.push(corners.len());
            corners.extend(hole);
        }
        if let ([a, b, c], true) = (corners.as_slice(), starts.is_empty()) {
            let triangles = vec![[*a, *b, *c]];
            return Some(Triangles { normal, triangles });
        }
        let flat = flatten(&corners, normal);
        self.earcut
            .earcut(flat.iter().copied(), &starts, &mut self.indices);
        let triangles = oriented(&self.indices, &flat);
        let wanted = flat_area(&flat, &starts);
        let found: f64 = triangles
            .iter()
            .map(|triangle| twice_area(triangle, &flat))
            .sum();
        let deviation = (found - wanted).abs();
        if wanted <= 0.0 || deviation.is_nan() || deviation > MOST_DEVIATION * wanted {
            return None;
        }
        let triangles: Vec<_> = triangles
            .iter()
            .map(|triangle| triangle.map(|corner| corners[corner]))
            .filter(|[a, b, c]| (b.at - a.at).cross(c.at - a.at).try_normalize().is_some())
            .collect();
        (!triangles.is_empty()).then_some(Triangles { normal, triangles })
    }
}

/// A ring without corners that repeat the one before them.
fn distinct(ring: &[Corner]) -> Vec<Corner> {
    let mut corners: Vec<Corner> = ring.to_vec();
    corners.dedup_by(|next, corner| next.at == corner.at);
    while corners.len() > 1
        && corners.first().map(|corner| corner.at) == corners.last().map(|corner| corner.at)
    {
        corners.pop();
    }
    corners
}

/// The normal of a ring by Newell's sum, as long as twice its area.
fn newell(ring: &[Corner]) -> DVec3 {
    let Some(origin) = ring.first().map(|corner| corner.at) else {
        return DVec3::ZERO;
    };
    let next = ring.iter().cycle().skip(1);
    ring.iter()
        .zip(next)
        .map(|(a, b)| (a.at - origin).cross(b.at - origin))
        .sum()
}

/// Corners without the axis that the normal is nearest to, so that a ring around the normal turns counterclockwise.
fn flatten(corners: &[Corner], normal: DVec3) -> Vec<[f64; 2]> {
    let size = normal.abs();
    let (first, second, along) = if size.z >= size.x && size.z >= size.y {
        (0, 1, normal.z)
    } else if size.x >= size.y {
        (1, 2, normal.x)
    } else {
        (2, 0, normal.y)
    };
    let (first, second) = if along < 0.0 {
        (second, first)
    } else {
        (first, second)
    };
    let origin = corners.first().map_or(DVec3::ZERO, |corner| corner.at);
    let flat = |corner: &Corner| {
        let offset = corner.at - origin;
        [offset[first], offset[second]]
    };
    corners.iter().map(flat).collect()
}

/// Triples of indices, each turned counterclockwise.
fn oriented(indices: &[usize], flat: &[[f64; 2]]) -> Vec<[usize; 3]> {
    let turned = |triple: &[usize]| {
        let &[a, b, c] = triple else { return None };
        let is_left = twice_area(&[a, b, c], flat) >= 0.0;
        Some(if is_left { [a, b, c] } else { [a, c, b] })
    };
    indices.chunks_exact(3).filter_map(turned).collect()
}

fn twice_area(&[a, b, c]: &[usize; 3], flat: &[[f64; 2]]) -> f64 {
    let [a, b, c] = [flat[a], flat[b], flat[c]];
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Twice the area of the outer ring less that of the holes, which begin at `starts`.
fn flat_area(flat: &[[f64; 2]], starts: &[usize]) -> f64 {
    let mut edges = vec![0];
    edges.extend(starts);
    edges.push(flat.len());
    let area = |ends: &[usize]| {
        let ring = &flat[ends[0]..ends[1]];
        let next = ring.iter().cycle().skip(1);
        let sum: f64 = ring
            .iter()
            .zip(next)
            .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
            .sum();
        sum.abs()
    };
    let areas: Vec<f64> = edges.windows(2).map(area).collect();
    2.0 * areas.first().copied().unwrap_or(0.0) - areas.iter().sum::<f64>()
}
