//! A city's file out of its triangles.

use super::bake::{BakeOptions, BakeReport, Ground, bake};
use super::codec;
use super::layout::BlockMap;
use super::merge::{NodeError, merge};
use super::scene::{FAR, Scene};
use super::surroundings::Grid;
use super::tree::{Node, Tree, child, root};
use crate::geo::{RasterInfo, SampleType};
use crate::schedule::{map_in_order, thread_count};
use crate::store::{DomainKind, EntropyKind, Header, Kind, TransformKind, Writer};
use crate::{Error, Result};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Least and greatest length of a leaf's edge, in metres.
const LEAF_SIDES: [f64; 2] = [1.0, 4096.0];
/// Metres from the lowest height to the floor, so that every ray that comes down meets a prism above it.
const BELOW: f64 = 1.0;
/// Metres that edges and corners are multiples of.
const QUANTUM: f64 = 1.0 / 1024.0;
/// Deepest tree: 2^14 leaves along an edge.
const MOST_LEVELS: u32 = 14;
/// Finest grid of triangles: 2^11 cells along an edge, as large as leaves or larger.
const MOST_GRID_LEVELS: u32 = 11;
/// Most blocks.
const MOST_NODES: usize = 900_000;
/// Bytes that a triangle takes while a city is built.
const TRIANGLE_BYTES: u64 = 160;

/// How a city is built.
#[derive(Clone, Debug, Default)]
pub struct CityOptions {
    /// How blocks are baked.
    pub bake: BakeOptions,
    /// Edge of a leaf in metres, at most; 0 for 64.
    pub leaf_side: f64,
    /// Memory that triangles and textures may take, in bytes; `None` for no limit.
    pub memory: Option<u64>,
    /// Threads, 0 for all processors. The file does not depend on it.
    pub threads: usize,
}

/// What was built.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CityReport {
    /// All blocks.
    pub blocks: u64,
    /// Those baked from triangles.
    pub leaves: u64,
    /// Levels of blocks.
    pub levels: u32,
    /// Bytes of the file.
    pub bytes: u64,
    /// What leaves could not keep.
    pub baked: BakeReport,
    /// Exposed texels of inner blocks that share a column.
    pub shared_inner_texels: u64,
}

/// A leaf's or an inner node's block while its brothers are awaited.
struct Done {
    map: BlockMap,
    error: NodeError,
    heights: [f32; 2],
}

/// Builds the city at `output`. On a plane, squares without triangles are not divided.
///
/// # Errors
///
/// [`Error::Argument`] for options out of range, a scene without triangles or with coordinates that are no numbers, and one that
/// needs more memory than it may have; [`Error::Io`]; [`Error::Cancelled`].
pub fn build_city(
    scene: &Scene,
    ground: &Ground,
    options: &CityOptions,
    output: &Path,
    progress: &mut dyn FnMut(u64, u64) -> bool,
) -> Result<CityReport> {
    check(scene, options)?;
    let (mut tree, grid) = plan(scene, ground.spacing.is_infinite(), options)?;
    let leaves = leaves_in_order(&tree);
    let mut baked = BakeReport::default();
    let mut blocks = Blocks {
        tree: &tree,
        spool: Spool::new(output, tree.nodes.len())?,
        pending: Vec::new(),
        found: Vec::new(),
        shared: 0,
    };
    let work = |index: usize| {
        let square = tree.square(&tree.nodes[leaves[index]]);
        let (map, baked) = bake(scene, &grid, ground, square, &options.bake)?;
        let bytes = codec::encode(&map)?;
        Ok::<_, Error>((map, baked, bytes))
    };
    let threads = thread_count(options.threads);
    map_in_order(threads, leaves.len(), work, |index, result| {
        let (map, own, bytes) = result?;
        baked.add(&own);
        let (heights, error) = (map.heights, NodeError::default());
        blocks.add(
            leaves[index],
            Done {
                map,
                error,
                heights,
            },
            &bytes,
        )?;
        match progress(index as u64 + 1, leaves.len() as u64) {
            true => Ok(()),
            false => Err(Error::Cancelled),
        }
    })?;
    let (found, mut spool, shared_inner_texels) = (blocks.found, blocks.spool, blocks.shared);
    for (node, heights, error) in found {
        (tree.nodes[node].heights, tree.nodes[node].error) = (heights, error);
    }
    tree.floor = f64::from(tree.nodes[0].heights[0]) - BELOW;
    Ok(CityReport {
        blocks: tree.nodes.len() as u64,
        leaves: tree.leaves() as u64,
        levels: tree.depth() + 1,
        bytes: write(&tree, scene, options, &mut spool, output)?,
        baked,
        shared_inner_texels,
    })
}

fn check(scene: &Scene, options: &CityOptions) -> Result<()> {
    let wrong = |message: String| Err(Error::Argument(message));
    if scene.triangles.is_empty() {
        return wrong("a city without triangles".to_owned());
    }
    let is_number = |corner: &[f64; 3]| corner.iter().all(|along| along.abs() < FAR);
    let is_sane = |at: &usize| scene.triangles[*at].corners.iter().all(is_number);
    if let Some(bad) = (0..scene.triangles.len()).find(|at| !is_sane(at)) {
        let corners = scene.triangles[bad].corners;
        return wrong(format!("triangle {bad} has impossible corners {corners:?}"));
    }
    let textures = scene.textures.iter().map(super::scene::Texture::bytes);
    options.check_memory(scene.triangles.len() as u64, textures.sum::<usize>() as u64)?;
    options.check()
}

impl CityOptions {
    /// Whether a city can be built so.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for options out of range.
    pub fn check(&self) -> Result<()> {
        let wrong = |message: String| Err(Error::Argument(message));
        let [least, most] = LEAF_SIDES;
        let side = self.leaf_side;
        if side != 0.0 && !(least..=most).contains(&side) {
            return wrong(format!(
                "leaves of {side} m: {least} to {most} are possible"
            ));
        }
        let bake = &self.bake;
        if !matches!(bake.side_texels, 32 | 64 | 128) {
            return wrong(format!(
                "blocks of {} texels a side: 32, 64 or 128 are needed",
                bake.side_texels
            ));
        }
        if !(1..=4096).contains(&bake.views) || !(16..=4096).contains(&bake.view_pixels) {
            return wrong(format!(
                "{} views of {} pixels a side",
                bake.views, bake.view_pixels
            ));
        }
        if !(bake.exposure > 0.0 && bake.exposure.is_finite()) {
            return wrong(format!("walls higher than {} m", bake.exposure));
        }
        Ok(())
    }

    /// Most triangles that the memory holds.
    pub fn most_triangles(&self) -> u64 {
        self.memory.unwrap_or(u64::MAX) / TRIANGLE_BYTES
    }

    /// Whether the memory holds a scene of so many triangles and bytes of textures.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] where it does not.
    pub fn check_memory(&self, triangles: u64, texture_bytes: u64) -> Result<()> {
        let bytes = triangles
            .saturating_mul(TRIANGLE_BYTES)
            .saturating_add(texture_bytes);
        match self.memory {
            Some(memory) if bytes > memory => Err(Error::Argument(format!(
                "{triangles} triangles and {texture_bytes} bytes of textures need {} MiB, more than the {} MiB allowed",
                bytes >> 20,
                memory >> 20
            ))),
            _ => Ok(()),
        }
    }
}

/// The nodes, coarse to fine, and the triangles in them. Where the ground `is_flat`, squares without triangles have no children.
fn plan(scene: &Scene, is_flat: bool, options: &CityOptions) -> Result<(Tree, Grid)> {
    let [low, high] = scene.bounds().unwrap_or_default();
    let leaf = if options.leaf_side == 0.0 {
        64.0
    } else {
        options.leaf_side
    };
    // A texel of margin, so that walls at the border have an outside.
    let margin = leaf / options.bake.side_texels as f64;
    let extent = (high[0] - low[0]).max(high[1] - low[1]) + 2.0 * margin;
    let is_enough = |levels: &u32| leaf * f64::from(1u32 << levels) >= extent;
    let Some(levels) = (0..=MOST_LEVELS).find(is_enough) else {
        return Err(Error::Argument(format!(
            "a city of {extent} m has more than 2^{MOST_LEVELS} leaves of {leaf} m along an edge"
        )));
    };
    // Texels of a whole number of quanta make the corners of all squares exact, so that neighbours share them.
    let texels = (options.bake.side_texels << levels) as f64;
    let extent = (extent / texels / QUANTUM).ceil() * QUANTUM * texels;
    let corner = [0, 1].map(|axis| {
        let corner = 0.5 * (low[axis] + high[axis] - extent);
        (corner / QUANTUM).round() * QUANTUM
    });
    let mut tree = Tree {
        corner,
        side: extent,
        floor: 0.0,
        side_texels: options.bake.side_texels,
        nodes: vec![root()],
    };
    let grid = Grid::over_square(scene, (corner, extent), levels.min(MOST_GRID_LEVELS));
    let mut next = 0;
    while next < tree.nodes.len() {
        let node = tree.nodes[next];
        let (corner, side) = tree.square(&node);
        let is_empty = || {
            grid.touching(scene, corner, corner.map(|at| at + side))
                .is_empty()
        };
        if node.level < levels && !(is_flat && is_empty()) {
            if tree.nodes.len() + 4 > MOST_NODES {
                return Err(Error::Argument(format!(
                    "more than {MOST_NODES} blocks: choose larger leaves than {leaf} m"
                )));
            }
            tree.nodes[next].children = Some(tree.nodes.len() as u32);
            let children = (0..4).map(|quarter| child(&node, next as u32, quarter));
            tree.nodes.extend(children);
        }
        next += 1;
    }
    Ok((tree, grid))
}

/// Leaves depth first, so that brothers come together.
fn leaves_in_order(tree: &Tree) -> Vec<usize> {
    let mut leaves = Vec::new();
    let mut stack = vec![0usize];
    while let Some(index) = stack.pop() {
        match tree.nodes[index].children {
            Some(first) => stack.extend((0..4).rev().map(|quarter| first as usize + quarter)),
            None => leaves.push(index),
        }
    }
    leaves
}

/// The blocks that are done, leaves depth first and each inner node after its children.
struct Blocks<'a> {
    tree: &'a Tree,
    spool: Spool,
    /// By level: those whose brothers are awaited.
    pending: Vec<Vec<Done>>,
    /// Nodes with the heights and errors that were found.
    found: Vec<(usize, [f32; 2], NodeError)>,
    /// Exposed texels of inner nodes that share a column.
    shared: u64,
}

impl Blocks<'_> {
    /// Takes a node's block, and merges the one above if it was the last of four.
    fn add(&mut self, node: usize, done: Done, bytes: &[u8]) -> Result<()> {
        self.spool.put(node, bytes)?;
        self.found.push((node, done.heights, done.error));
        let Node { level, parent, .. } = self.tree.nodes[node];
        let level = level as usize;
        let levels = self.pending.len().max(level + 1);
        self.pending.resize_with(levels, Vec::new);
        self.pending[level].push(done);
        let (Some(parent), [a, b, c, d]) = (parent, &self.pending[level][..]) else {
            return Ok(());
        };
        let (map, mut error, shared) = merge([&a.map, &b.map, &c.map, &d.map])?;
        let mut heights = map.heights;
        for child in &self.pending[level] {
            let [low, high] = child.heights;
            heights = [heights[0].min(low), heights[1].max(high)];
            error.height = error.height.max(child.error.height);
            error.colour = error.colour.max(child.error.colour);
        }
        self.pending[level].clear();
        self.shared += shared as u64;
        let bytes = codec::encode(&map)?;
        self.add(
            parent as usize,
            Done {
                map,
                error,
                heights,
            },
            &bytes,
        )
    }
}

/// Encoded blocks in the order in which they come, in a file without a name.
struct Spool {
    file: File,
    path: std::path::PathBuf,
    places: Vec<(u64, usize)>,
    end: u64,
}

impl Spool {
    fn new(output: &Path, nodes: usize) -> Result<Spool> {
        let folder = match output.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let file = tempfile::tempfile_in(folder)
            .map_err(Error::io(folder, "cannot write into the folder"))?;
        Ok(Spool {
            file,
            path: folder.to_path_buf(),
            places: vec![(0, 0); nodes],
            end: 0,
        })
    }

    fn put(&mut self, node: usize, bytes: &[u8]) -> Result<()> {
        self.file
            .write_all(bytes)
            .map_err(Error::io(&self.path, "cannot write into the folder"))?;
        self.places[node] = (self.end, bytes.len());
        self.end += bytes.len() as u64;
        Ok(())
    }

    fn get(&mut self, node: usize) -> Result<Vec<u8>> {
        let (start, length) = self.places[node];
        let mut bytes = vec![0; length];
        let mut read = || -> io::Result<()> {
            self.file.seek(SeekFrom::Start(start))?;
            self.file.read_exact(&mut bytes)
        };
        read().map_err(Error::io(&self.path, "cannot read back from the folder"))?;
        Ok(bytes)
    }
}

fn write(
    tree: &Tree,
    scene: &Scene,
    options: &CityOptions,
    spool: &mut Spool,
    output: &Path,
) -> Result<u64> {
    let header = header(tree, scene, options);
    let roots = tree.encode().map_err(Error::Argument)?;
    let mut writer = Writer::create(output, &header, &roots, &[])?;
    for node in 0..tree.nodes.len() {
        writer.push(&spool.get(node)?)?;
    }
    writer.finish(&header, &vec![[0; 3]; tree.nodes.len()])
}

fn header(tree: &Tree, scene: &Scene, options: &CityOptions) -> Header {
    let side_texels = options.bake.side_texels as u32;
    let width = side_texels << tree.depth();
    let texel = tree.side / f64::from(width);
    let sample_type = if options.bake.has_16_bits {
        SampleType::U16
    } else {
        SampleType::U8
    };
    let [low, high] = tree.nodes[0].heights.map(f64::from);
    Header {
        kind: Kind::City,
        domain: DomainKind::Planar,
        transform: TransformKind::Interpolating,
        entropy: EntropyKind::Gamma,
        cells_log2: side_texels.ilog2() as u8,
        levels: 2 * tree.depth() as u8,
        lossless: false,
        // An image of noise is longer than 65534 times 4 bytes.
        block_length_unit: 8,
        bound_units: 0,
        unit_min: 0,
        unit_max: if options.bake.has_16_bits { 65535 } else { 255 },
        unit_scale: 1.0,
        unit_offset: 0.0,
        sample_min: low,
        sample_max: high,
        max_error_bound: 0.0,
        max_error: 0.0,
        rms_error: 0.0,
        samples: tree.leaves() as u64 * u64::from(side_texels).pow(2),
        void_samples: 0,
        block_count: tree.nodes.len() as u64,
        raster: RasterInfo {
            geotransform: [tree.corner[0], texel, 0.0, tree.corner[1], 0.0, texel],
            georeferenced: true,
            crs: scene.crs.clone(),
            units: "metre".to_owned(),
            ..RasterInfo::new(width, width, sample_type)
        },
    }
}
