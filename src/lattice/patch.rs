//! One half of a diamond as a vertex buffer: its order of vertices and the triangles they share.

/// The corner of a diamond's matrix at which a half has its right angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Apex {
    /// (0, 0)
    Origin,
    /// (N, 0)
    Right,
    /// (N, N)
    Far,
    /// (0, N)
    Bottom,
}

impl Apex {
    /// Matrix indices (i, j) of the corner.
    pub fn corner(self, cells: usize) -> (usize, usize) {
        match self {
            Apex::Origin => (0, 0),
            Apex::Right => (cells, 0),
            Apex::Far => (cells, cells),
            Apex::Bottom => (0, cells),
        }
    }

    /// First and last i of row j of the closed half.
    pub fn row(self, cells: i64, j: i64) -> (i64, i64) {
        match self {
            Apex::Origin => (0, cells - j),
            Apex::Right => (j, cells),
            Apex::Far => (cells - j, cells),
            Apex::Bottom => (0, j),
        }
    }

    /// Matrix indices of the vertex p steps along the first leg and q along the second; the legs are
    /// those of [`Apex::Origin`], turned, so that all halves have the same orientation.
    pub fn vertex(self, cells: usize, p: usize, q: usize) -> (usize, usize) {
        match self {
            Apex::Origin => (p, q),
            Apex::Right => (cells - q, p),
            Apex::Far => (cells - p, cells - q),
            Apex::Bottom => (q, cells - p),
        }
    }

    /// Matrix indices of the vertex across the hypotenuse.
    pub fn mirrored(self, cells: usize, i: usize, j: usize) -> (usize, usize) {
        match self {
            Apex::Right | Apex::Bottom => (j, i),
            Apex::Origin | Apex::Far => (cells - j, cells - i),
        }
    }

    /// Whether cell (i, j)'s centre belongs to the closed half.
    pub fn holds_centre(self, cells: usize, i: usize, j: usize) -> bool {
        match self {
            Apex::Origin => i + j < cells,
            Apex::Right => i >= j,
            Apex::Far => i + j + 1 >= cells,
            Apex::Bottom => j >= i,
        }
    }
}

/// Vertex order and triangles of every complete patch of N cells.
///
/// Vertex (p, q), p + q <= N, has index `q (N + 1) - q (q - 1) / 2 + p`; (0, 0) is the right angle, and
/// the long edges of the N^2 triangles are parallel to the hypotenuse p + q = N.
#[derive(Clone, Debug)]
pub struct PatchGrid {
    cells: usize,
    /// Triangles turn from the first leg away from the second.
    flipped: bool,
    orders: [Vec<u16>; 4],
}

impl PatchGrid {
    /// The grid of patches of `cells` (at most 128) cells; `flipped` turns all triangles over.
    pub fn new(cells: usize, flipped: bool) -> PatchGrid {
        let order = |apex: Apex| {
            let rows = (0..=cells).flat_map(|q| (0..=cells - q).map(move |p| (p, q)));
            rows.map(|(p, q)| {
                let (i, j) = apex.vertex(cells, p, q);
                (j * (cells + 1) + i) as u16
            })
            .collect()
        };
        let orders = [Apex::Origin, Apex::Right, Apex::Far, Apex::Bottom].map(order);
        PatchGrid {
            cells,
            flipped,
            orders,
        }
    }

    /// Number of vertices, (N + 1)(N + 2) / 2.
    pub fn vertex_count(&self) -> usize {
        (self.cells + 1) * (self.cells + 2) / 2
    }

    /// For each patch vertex its index in the diamond's vertex matrix.
    pub fn matrix_indices(&self, apex: Apex) -> &[u16] {
        &self.orders[apex as usize]
    }

    /// Index of vertex (p, q).
    pub fn vertex(&self, p: usize, q: usize) -> u16 {
        (q * (self.cells + 1) + p - q * q.saturating_sub(1) / 2) as u16
    }

    /// All triangles, three indices each, in columns of eight cells so that a small vertex cache serves
    /// most of them.
    pub fn triangle_list(&self) -> Vec<u16> {
        let mut list = Vec::with_capacity(3 * self.cells * self.cells);
        for first in (0..self.cells).step_by(8) {
            for q in 0..self.cells - first {
                for p in first..(first + 8).min(self.cells - q) {
                    list.extend(self.wound([(p, q), (p + 1, q), (p, q + 1)]));
                    if p + q + 1 < self.cells {
                        list.extend(self.wound([(p + 1, q), (p + 1, q + 1), (p, q + 1)]));
                    }
                }
            }
        }
        list
    }

    /// The same triangles as one strip; rows are joined by triangles without area.
    pub fn triangle_strip(&self) -> Vec<u16> {
        let mut strip: Vec<u16> = Vec::new();
        for q in 0..self.cells {
            let near = |p: usize| self.vertex(p, q);
            let far = |p: usize| self.vertex(p, q + 1);
            let start = near(0);
            if let Some(&last) = strip.last() {
                strip.extend([last, start]);
            }
            // A strip's triangle at an even place keeps its order, at an odd one it is turned over. The
            // row's first triangle (near 0, far 0, near 1) is turned over against the list's.
            if strip.len().is_multiple_of(2) != self.flipped {
                strip.push(start);
            }
            strip.push(start);
            for p in 0..self.cells - q {
                strip.extend([far(p), near(p + 1)]);
            }
        }
        strip
    }

    fn wound(&self, corners: [(usize, usize); 3]) -> [u16; 3] {
        let [a, b, c] = corners.map(|(p, q)| self.vertex(p, q));
        if self.flipped { [a, c, b] } else { [a, b, c] }
    }
}
