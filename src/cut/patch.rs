//! Patches: halves of diamonds as vertex buffers.

use super::births::Birth;
use super::colours::ColourForm;
use super::graph::Content;
use super::node::Node;
use super::samples::Ground;
use super::stock::Stock;
use crate::codec::Matrix;
use crate::lattice::{Apex, Diamond, Lattice, PatchGrid, Placement};

/// What a patch's vertices hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VertexForm {
    /// 3 floats: height relative to the patch's origin in height units, dz/dx, dz/dy in world units.
    Compact,
    /// 6 floats: x, y, z relative to the patch's origin in grid coordinates and height units
    /// (integers), then the unit normal in the world.
    Expanded,
}

impl VertexForm {
    /// Floats of one vertex.
    pub fn floats(self) -> usize {
        match self {
            VertexForm::Compact => 3,
            VertexForm::Expanded => 6,
        }
    }
}

/// The affine map from grid coordinates (column, row, height unit) to the world, axis by axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridToWorld {
    /// World position of the grid's origin.
    pub origin: [f64; 3],
    /// World units of one grid unit.
    pub step: [f64; 3],
}

/// One half of a diamond, as drawn. It never changes.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Unique among the patches of a cut.
    pub handle: u64,
    /// The diamond.
    pub diamond: Diamond,
    /// Which of its halves.
    pub half: u8,
    /// Level of the diamond.
    pub level: u32,
    /// Grid coordinates of the right angle, integers; the third is one base height for the whole cut.
    pub origin: [f64; 3],
    /// Grid steps of p and of q: vertex (p, q) lies at `origin + p legs[0] + q legs[1]`.
    pub legs: [[f32; 2]; 2],
    /// World positions of the right angle, the end of p and the end of q.
    pub corners: [[f64; 3]; 3],
    /// World box of the vertices, low and high.
    pub bounds: [[f64; 3]; 2],
    /// Upper bound of the distance to the finest surface in world units; may be infinite.
    pub error: f64,
    /// Vertices in the order of [`PatchGrid`], in the cut's form.
    pub vertices: Box<[f32]>,
    /// `None` where the patch is complete and drawn by the shared index buffers; else its own list of
    /// triangles.
    pub indices: Option<Box<[u16]>>,
    /// Its colours, in a cut that has any.
    pub colours: Option<PatchColours>,
    /// Where its vertices came from, in the same order, in a cut that tells it: the height, relative to the patch's origin in
    /// units, of the middle of the edge that a vertex divided when it came, and the level of the diamonds that first had it.
    /// These are the same in all patches that share a vertex.
    pub births: Option<Box<[[f32; 2]]>>,
}

/// The colours of a patch.
#[derive(Clone, Debug)]
pub struct PatchColours {
    /// In the form that was chosen ([`ColourForm`]).
    pub bytes: Box<[u8]>,
    /// Texels along a side of the texture; 0 where each vertex has a colour.
    pub texture_side: usize,
    /// Texture coordinates of the right angle, the end of p and the end of q: the middles of their texels, of a texture that
    /// is 1 x 1.
    pub texture_corners: [[f32; 2]; 3],
}

impl Patch {
    /// Bytes of the vertices, of all that goes with them, and of the patch's own list.
    pub fn bytes(&self) -> u64 {
        fn size<T>(slice: Option<&[T]>) -> usize {
            slice.map_or(0, size_of_val)
        }
        let colours = self.colours.as_ref().map(|colours| &*colours.bytes);
        let beside = size(self.indices.as_deref()) + size(self.births.as_deref()) + size(colours);
        (size_of_val(&*self.vertices) + beside) as u64
    }
}

/// A half to make a patch of.
struct Shape<'a> {
    apex: Apex,
    placement: Placement,
    /// Triangles are drawn where all of their vertices are valid ([`Lattice::draws`]).
    draws_valid: bool,
    content: &'a Content,
}

/// Makes the patches of one cut.
pub(super) struct PatchMaker {
    grid: PatchGrid,
    triangle_list: Box<[u16]>,
    /// (p, q) of every vertex.
    positions: Box<[[f32; 2]]>,
    form: VertexForm,
    has_births: bool,
    base: i32,
    grid_to_world: GridToWorld,
    lattice: Lattice,
    ground: Ground,
}

impl PatchMaker {
    pub fn new(ground: &Ground, form: VertexForm, has_births: bool) -> PatchMaker {
        let source = &*ground.heights;
        let (lattice, frame) = (source.lattice(), source.frame());
        let [offset, scale] = source.height_to_world();
        // Counter-clockwise from above: rows that run south turn the grid over.
        let flipped = frame.step[0] * frame.step[1] < 0.0;
        let grid = PatchGrid::new(lattice.cells(), flipped);
        let [low, high] = source.range().map(i64::from);
        PatchMaker {
            triangle_list: grid.triangle_list().into(),
            positions: positions(lattice.cells())
                .map(|(p, q)| [p as f32, q as f32])
                .collect(),
            grid,
            form,
            has_births,
            base: ((low + high) / 2) as i32,
            grid_to_world: GridToWorld {
                origin: [frame.origin[0], frame.origin[1], offset],
                step: [frame.step[0], frame.step[1], scale],
            },
            lattice: lattice.clone(),
            ground: ground.clone(),
        }
    }

    /// Whether patches tell where their vertices came from.
    pub fn has_births(&self) -> bool {
        self.has_births
    }

    /// The height that those of vertices are relative to.
    pub fn base(&self) -> i32 {
        self.base
    }

    /// Of the root's vertices.
    pub fn first_births(&self, heights: &Matrix) -> Box<[Birth]> {
        let heights = heights.values.iter();
        heights
            .map(|&unit| [(i64::from(unit) - i64::from(self.base)) as f32, 0.0])
            .collect()
    }

    pub fn grid(&self) -> &PatchGrid {
        &self.grid
    }

    pub fn triangle_list(&self) -> &[u16] {
        &self.triangle_list
    }

    /// (p, q) of every vertex.
    pub fn positions(&self) -> &[[f32; 2]] {
        &self.positions
    }

    pub fn grid_to_world(&self) -> GridToWorld {
        self.grid_to_world
    }

    /// Bytes of a patch's vertices, and the most that its own list takes.
    pub fn patch_bytes(&self) -> [u64; 2] {
        let colours = self.ground.colours.as_ref();
        let colours = colours.map_or(0, |colours| {
            colours.bytes(self.grid.vertex_count()) as usize
        });
        let births = usize::from(self.has_births) * size_of::<Birth>();
        let each = self.form.floats() * size_of::<f32>() + births;
        let vertices = self.grid.vertex_count() * each + colours;
        [vertices, size_of_val(&*self.triangle_list)].map(|bytes| bytes as u64)
    }

    /// The patch of a half that has arrived; `None` where none of its triangles is drawn.
    pub fn make(
        &self,
        node: &Node,
        content: &Content,
        (half, handle): (usize, u64),
        stock: &mut Stock,
    ) -> Option<Patch> {
        let shape = Shape {
            apex: self.lattice.apexes(node.diamond)[half],
            placement: self.lattice.placement(node.diamond),
            // Cells at 45 degrees are cut by the domain's border.
            draws_valid: node.has_all_samples && node.level.is_multiple_of(2),
            content,
        };
        let indices = self.own_indices(&shape);
        if indices.as_ref().is_some_and(|indices| indices.is_empty()) {
            return None;
        }
        let cells = self.lattice.cells();
        let at = |p, q| {
            let (i, j) = shape.apex.vertex(cells, p, q);
            (
                shape.placement.vertex(i, j),
                content.samples.heights.values[j * (cells + 1) + i],
            )
        };
        let ([column, row], _) = at(0, 0);
        let leg = |(end, _): ([i64; 2], i32)| [(end[0] - column) as f32, (end[1] - row) as f32];
        let legs = [leg(at(1, 0)), leg(at(0, 1))];
        let corners = [at(0, 0), at(cells, 0), at(0, cells)]
            .map(|([column, row], unit)| self.world([column as f64, row as f64, f64::from(unit)]));
        let floats = self.grid.vertex_count() * self.form.floats();
        let mut vertices = stock.take_vertices(floats);
        let range = self.fill(&shape, legs, &mut vertices);
        Some(Patch {
            handle,
            diamond: node.diamond,
            half: half as u8,
            level: node.level,
            origin: [column as f64, row as f64, f64::from(self.base)],
            legs,
            corners,
            bounds: self.bounds(range, &corners),
            error: node.bounds.error,
            vertices,
            indices,
            colours: self.colours(&shape),
            births: self.births(&shape),
        })
    }

    fn colours(&self, shape: &Shape) -> Option<PatchColours> {
        let (colours, texels) = (
            self.ground.colours.as_ref()?,
            shape.content.samples.texels.as_ref()?,
        );
        let (cells, apex) = (self.lattice.cells(), shape.apex);
        if colours.form == ColourForm::Vertices {
            let order = self.grid.matrix_indices(apex);
            return Some(PatchColours {
                bytes: colours.of_vertices(&texels.matrix, cells, order),
                texture_side: 0,
                texture_corners: [[0.0; 2]; 3],
            });
        }
        let side = colours.texture_side();
        let middle = |texel: usize| (texel as f32 + 0.5) / side as f32;
        let corner = |(p, q)| {
            let (i, j) = apex.vertex(side - 1, p, q);
            [middle(i), middle(j)]
        };
        Some(PatchColours {
            bytes: colours.texture(&texels.matrix, apex),
            texture_side: side,
            texture_corners: [(0, 0), (side - 1, 0), (0, side - 1)].map(corner),
        })
    }

    fn births(&self, shape: &Shape) -> Option<Box<[Birth]>> {
        let births = shape.content.births.as_ref()?;
        let order = self.grid.matrix_indices(shape.apex).iter();
        Some(order.map(|&index| births[usize::from(index)]).collect())
    }

    fn world(&self, grid: [f64; 3]) -> [f64; 3] {
        let GridToWorld { origin, step } = &self.grid_to_world;
        std::array::from_fn(|axis| origin[axis] + step[axis] * grid[axis])
    }

    /// The box of vertices whose units are in `range`.
    fn bounds(&self, range: [i32; 2], corners: &[[f64; 3]; 3]) -> [[f64; 3]; 2] {
        let ends = range.map(|unit| self.world([0.0, 0.0, f64::from(unit)])[2]);
        let fold = |axis: usize, pick: fn(f64, f64) -> f64| {
            pick(pick(corners[0][axis], corners[1][axis]), corners[2][axis])
        };
        [
            [fold(0, f64::min), fold(1, f64::min), ends[0].min(ends[1])],
            [fold(0, f64::max), fold(1, f64::max), ends[0].max(ends[1])],
        ]
    }

    /// Writes the vertices, and gives the least and greatest of their units.
    fn fill(&self, shape: &Shape, legs: [[f32; 2]; 2], target: &mut [f32]) -> [i32; 2] {
        let order = self.grid.matrix_indices(shape.apex).chunks(LANES);
        let Content {
            samples, slopes, ..
        } = shape.content;
        let floats = self.form.floats();
        let targets = target.chunks_mut(LANES * floats);
        let mut range = [i32::MAX, i32::MIN];
        for ((order, positions), target) in order.zip(self.positions.chunks(LANES)).zip(targets) {
            let mut lanes = Lanes::default();
            for (lane, &index) in order.iter().enumerate() {
                let unit = samples.heights.values[usize::from(index)];
                range = [range[0].min(unit), range[1].max(unit)];
                lanes.height[lane] = (i64::from(unit) - i64::from(self.base)) as f32;
                [lanes.dx[lane], lanes.dy[lane]] = slopes[usize::from(index)];
            }
            match self.form {
                VertexForm::Compact => lanes.write_compact(target),
                VertexForm::Expanded => lanes.write_expanded(positions, legs, target),
            }
        }
        range
    }

    /// The list of triangles drawn ([`Lattice::draws`]), or `None` where all are.
    fn own_indices(&self, shape: &Shape) -> Option<Box<[u16]>> {
        let Shape {
            apex,
            placement,
            draws_valid,
            content,
        } = *shape;
        let heights = &content.samples.heights;
        let cells = self.lattice.cells();
        let order = self.grid.matrix_indices(apex);
        let is_inside = [(0, 0), (cells, 0), (0, cells)].iter().all(|&(p, q)| {
            let (i, j) = apex.vertex(cells, p, q);
            self.lattice.in_raster(placement.vertex(i, j))
        });
        let is_valid = |&index: &u16| heights.is_valid(usize::from(index));
        if is_inside && (heights.valid.is_none() || order.iter().all(is_valid)) {
            return None;
        }
        let places: Vec<[i64; 2]> = positions(cells)
            .map(|(p, q)| {
                let (i, j) = apex.vertex(cells, p, q);
                placement.vertex(i, j)
            })
            .collect();
        let is_drawn = |triangle: &&[u16]| {
            let corners: [usize; 3] = std::array::from_fn(|corner| usize::from(triangle[corner]));
            let valid = corners.map(|vertex| heights.is_valid(usize::from(order[vertex])));
            self.lattice
                .draws(draws_valid, corners.map(|vertex| places[vertex]), valid)
        };
        let drawn: Vec<u16> = self
            .triangle_list
            .chunks_exact(3)
            .filter(is_drawn)
            .flatten()
            .copied()
            .collect();
        (drawn.len() < self.triangle_list.len()).then(|| drawn.into())
    }
}

/// Vertices that are made at once.
const LANES: usize = 32;

/// Some vertices, number by number, so that normals are computed in vectors.
#[derive(Default)]
struct Lanes {
    height: [f32; LANES],
    dx: [f32; LANES],
    dy: [f32; LANES],
}

impl Lanes {
    fn write_compact(&self, target: &mut [f32]) {
        let (vertices, _) = target.as_chunks_mut::<3>();
        for (lane, vertex) in vertices.iter_mut().enumerate() {
            *vertex = [self.height[lane], self.dx[lane], self.dy[lane]];
        }
    }

    fn write_expanded(&self, positions: &[[f32; 2]], legs: [[f32; 2]; 2], target: &mut [f32]) {
        let up: [f32; LANES] = std::array::from_fn(|lane| {
            let (dx, dy) = (self.dx[lane], self.dy[lane]);
            1.0 / (1.0 + dx * dx + dy * dy).sqrt()
        });
        let (vertices, _) = target.as_chunks_mut::<6>();
        for (lane, (vertex, [p, q])) in vertices.iter_mut().zip(positions).enumerate() {
            let [x, y] = [0, 1].map(|axis| p * legs[0][axis] + q * legs[1][axis]);
            let (dx, dy, up) = (self.dx[lane], self.dy[lane], up[lane]);
            *vertex = [x, y, self.height[lane], -dx * up, -dy * up, up];
        }
    }
}

/// (p, q) of a patch's vertices in their order.
fn positions(cells: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..=cells).flat_map(move |q| (0..=cells - q).map(move |p| (p, q)))
}
