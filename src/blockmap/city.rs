//! An open city.

use super::codec;
use super::layout::BlockMap;
use super::tree::Tree;
use crate::store::{Access, Header, Kind, Store};
use crate::{Error, Result};
use std::path::Path;

/// A repository of BlockMaps. Any number of threads may use one at once.
#[derive(Debug)]
pub struct City {
    store: Store,
    tree: Tree,
}

impl City {
    /// Opens the city at `path`.
    ///
    /// # Errors
    ///
    /// Those of [`Store::open`]; [`Error::Input`] for a repository of another kind; [`Error::Damaged`] for a tree that
    /// contradicts itself.
    pub fn open(path: &Path, access: Access) -> Result<City> {
        City::of_store(Store::open(path, access)?)
    }

    /// As [`open`](Self::open), of an open file.
    ///
    /// # Errors
    ///
    /// As [`open`](Self::open).
    pub fn of_store(store: Store) -> Result<City> {
        let header = store.header();
        if header.kind != Kind::City {
            return Err(Error::input(store.path(), "it is not a city"));
        }
        let tree =
            tree_of(header, store.roots()).map_err(|cause| Error::damaged(store.path(), cause))?;
        if tree.nodes.len() as u64 != header.block_count {
            let (nodes, blocks) = (tree.nodes.len(), header.block_count);
            let message = format!("a tree of {nodes} nodes over {blocks} blocks");
            return Err(Error::damaged(store.path(), message));
        }
        Ok(City { store, tree })
    }

    /// Where its blocks are.
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// Its file.
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Texels along a block.
    pub fn side_texels(&self) -> usize {
        1 << self.store.header().cells_log2
    }

    /// Decodes the BlockMap of a node.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a node that does not exist; [`Error::Damaged`] naming the block; those of reading.
    pub fn read(&self, node: u32) -> Result<BlockMap> {
        let mut scratch = Vec::new();
        let bytes = self.store.block(u64::from(node), &mut scratch)?;
        let square = match self.tree.nodes.get(node as usize) {
            Some(found) => self.tree.square(found),
            None => return Err(Error::Argument(format!("there is no node {node}"))),
        };
        let damaged =
            |cause: String| Error::damaged(self.store.path(), format!("block {node}: {cause}"));
        let map = codec::decode(bytes, square).map_err(damaged)?;
        if map.side_texels != self.side_texels() {
            return Err(damaged(format!("it has {} texels a side", map.side_texels)));
        }
        Ok(map)
    }
}

fn tree_of(header: &Header, roots: &[u8]) -> std::result::Result<Tree, String> {
    let [west, texel, turn, south, lean, down] = header.raster.geotransform;
    let side = texel * f64::from(header.raster.width);
    let is_square = header.raster.width == header.raster.height && texel == down;
    let is_sane = [west, south, side].iter().all(|number| number.is_finite());
    if !is_square || !is_sane || side <= 0.0 || turn != 0.0 || lean != 0.0 {
        return Err("a city whose texels are not a north-up square".to_owned());
    }
    let depth = u32::from(header.levels) / 2;
    if depth + u32::from(header.cells_log2) > 31
        || header.raster.width != 1 << (depth + u32::from(header.cells_log2))
    {
        let width = header.raster.width;
        return Err(format!("{width} texels at {depth} levels of blocks"));
    }
    Tree::decode(roots, ([west, south], side), depth, 1 << header.cells_log2)
}
