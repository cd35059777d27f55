//! The quadtree of a city: small enough to be held whole.

use super::merge::NodeError;
use crate::store::SECTION_LIMIT;

/// Bytes of a node in the roots section: whether it has children, heights, errors.
const NODE_BYTES: usize = 1 + 4 * 4;
/// Bytes before the nodes: the floor, and how many nodes.
const HEAD_BYTES: usize = 8 + 4;
const COMPRESSION_LEVEL: i32 = 19;

/// A square of the city.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// 0 for the root.
    pub level: u32,
    /// Column and row among the squares of its level, from the south-west.
    pub place: [u32; 2],
    /// `None` for the root.
    pub parent: Option<u32>,
    /// The first of its four children, which follow each other: south-west, south-east, north-west, north-east.
    pub children: Option<u32>,
    /// Least and greatest height of its BlockMap and of all below it, in metres.
    pub heights: [f32; 2],
    /// How far it is from the finest BlockMaps: at least as far as its children.
    pub error: NodeError,
}

/// All nodes, coarse to fine, brothers together; a node's index is the rank of its block.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// South-west corner of the root's square, in metres.
    pub corner: [f64; 2],
    /// Its edge, in metres.
    pub side: f64,
    /// Down to where all prisms reach, in metres.
    pub floor: f64,
    /// Texels along a block.
    pub side_texels: usize,
    /// At least the root.
    pub nodes: Vec<Node>,
}

impl Tree {
    /// South-west corner and edge of a node's square, in metres. Squares that touch have equal edges, bit for bit.
    pub fn square(&self, node: &Node) -> ([f64; 2], f64) {
        let side = self.side / f64::from(1u32 << node.level);
        let corner = [0, 1].map(|axis| self.corner[axis] + side * f64::from(node.place[axis]));
        (corner, side)
    }

    /// The deepest level.
    pub fn depth(&self) -> u32 {
        self.nodes.last().map_or(0, |node| node.level)
    }

    /// Count of nodes without children.
    pub fn leaves(&self) -> usize {
        let leaves = self.nodes.iter().filter(|node| node.children.is_none());
        leaves.count()
    }

    /// The roots section.
    pub(super) fn encode(&self) -> std::result::Result<Vec<u8>, String> {
        let mut plain = self.floor.to_le_bytes().to_vec();
        plain.extend((self.nodes.len() as u32).to_le_bytes());
        for node in &self.nodes {
            plain.push(u8::from(node.children.is_some()));
            let numbers = [
                node.heights[0],
                node.heights[1],
                node.error.height,
                node.error.colour,
            ];
            plain.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        }
        if plain.len() as u64 > SECTION_LIMIT {
            return Err(format!(
                "{} blocks are more than a file holds",
                self.nodes.len()
            ));
        }
        zstd::bulk::compress(&plain, COMPRESSION_LEVEL)
            .map_err(|error| format!("the tree cannot be compressed: {error}"))
    }

    /// The inverse of [`encode`](Self::encode), over a square.
    pub(super) fn decode(
        section: &[u8],
        (corner, side): ([f64; 2], f64),
        depth: u32,
        side_texels: usize,
    ) -> std::result::Result<Tree, String> {
        let plain = zstd::bulk::decompress(section, SECTION_LIMIT as usize)
            .map_err(|error| format!("the tree cannot be decompressed: {error}"))?;
        let Some((head, body)) = plain.split_first_chunk::<HEAD_BYTES>() else {
            return Err(format!("a tree of {} bytes", plain.len()));
        };
        let [a, b, c, d, e, f, g, h, count @ ..] = *head;
        let floor = f64::from_le_bytes([a, b, c, d, e, f, g, h]);
        let count = u32::from_le_bytes(count) as usize;
        if body.len() != count * NODE_BYTES || count == 0 || !floor.is_finite() {
            let length = body.len();
            return Err(format!(
                "{count} nodes in {length} bytes over a floor at {floor}"
            ));
        }
        let mut tree = Tree {
            corner,
            side,
            floor,
            side_texels,
            nodes: vec![root()],
        };
        for (index, bytes) in body.as_chunks::<NODE_BYTES>().0.iter().enumerate() {
            tree.fill(index, bytes, depth)?;
            // Before they take more memory than their bytes promised.
            if tree.nodes.len() > count {
                return Err(format!("more than {count} nodes"));
            }
        }
        if tree.nodes.len() != count {
            return Err(format!("{} nodes instead of {count}", tree.nodes.len()));
        }
        Ok(tree)
    }

    fn fill(
        &mut self,
        index: usize,
        bytes: &[u8; NODE_BYTES],
        depth: u32,
    ) -> std::result::Result<(), String> {
        let next = self.nodes.len() as u32;
        let Some(node) = self.nodes.get_mut(index) else {
            return Err(format!("node {index} has no parent"));
        };
        let number = |at: usize| {
            let first = 1 + 4 * at;
            f32::from_le_bytes([
                bytes[first],
                bytes[first + 1],
                bytes[first + 2],
                bytes[first + 3],
            ])
        };
        let [low, high, height, colour] = [0, 1, 2, 3].map(number);
        let is_sane = low <= high && [low, high, height, colour].iter().all(|n| n.is_finite());
        if !is_sane || bytes[0] > 1 || (bytes[0] == 1 && node.level >= depth) {
            return Err(format!("node {index} is impossible"));
        }
        node.heights = [low, high];
        node.error = NodeError { height, colour };
        if bytes[0] == 1 {
            node.children = Some(next);
            let node = *node;
            self.nodes
                .extend((0..4).map(|quarter| child(&node, index as u32, quarter)));
        }
        Ok(())
    }
}

/// The root, with nothing known of it.
pub(super) fn root() -> Node {
    Node {
        level: 0,
        place: [0; 2],
        parent: None,
        children: None,
        heights: [0.0; 2],
        error: NodeError::default(),
    }
}

/// A quarter of a node, with nothing known of it.
pub(super) fn child(node: &Node, index: u32, quarter: u32) -> Node {
    Node {
        level: node.level + 1,
        place: [
            2 * node.place[0] + quarter % 2,
            2 * node.place[1] + quarter / 2,
        ],
        parent: Some(index),
        ..root()
    }
}
