//! The subcommands about cities.

use crate::arguments;
use crate::commands::{Outcome, open_heights, start_progress};
use crate::complain;
use crate::report::Report;
use kimberlite::Result;
use kimberlite::blockmap::source::{SourceOptions, read};
use kimberlite::blockmap::{
    BARE_GROUND, BakeOptions, City, CityOptions, Ground, Ray, Scene, Visit, build_city, write_png,
};
use kimberlite::cut::{DiamondSource, Query};
use kimberlite::store::{Access, Kind, Store};
use kimberlite::tool::{self, Original, Render, peak_memory_bytes};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Decoded terrain that may be held while a city is built on it.
const QUERY_BYTES: u64 = 64 << 20;

/// What a city stands on: a terrain, and a plane where that has no heights.
struct Base {
    terrain: Option<Mutex<Query>>,
    plane: f64,
}

impl Base {
    fn new(scene: &Scene, terrain: Option<&Path>) -> Result<Base> {
        let open = |file: &Path| Ok(Mutex::new(Query::new(open_heights(file)?, QUERY_BYTES)));
        Ok(Base {
            terrain: terrain.map(open).transpose()?,
            plane: scene.bounds().map_or(0.0, |[low, _]| low[2]),
        })
    }

    fn height(&self, [x, y]: [f64; 2]) -> f64 {
        let height = self.terrain.as_ref().and_then(|query| {
            let mut query = query.lock().unwrap_or_else(PoisonError::into_inner);
            query.height_at_world(x, y).ok().flatten()
        });
        height.map_or(self.plane, |height| height.height)
    }

    fn spacing(&self) -> f64 {
        self.terrain.as_ref().map_or(f64::INFINITY, |query| {
            let query = query.lock().unwrap_or_else(PoisonError::into_inner);
            let step = query.terrain().frame().step;
            step[0].abs().min(step[1].abs())
        })
    }

    /// Where a ray meets the plane.
    fn meet(&self, ray: &Ray) -> Option<(f64, [f32; 3])> {
        let [_, _, z] = ray.origin;
        let distance = (self.plane - z) / ray.direction[2];
        (distance > 0.0 && distance.is_finite()).then_some((distance, [0.0, 0.0, 1.0]))
    }
}

fn read_scene(inputs: &[PathBuf], facades: Option<u32>) -> Result<Scene> {
    let options = SourceOptions {
        facades,
        ..SourceOptions::default()
    };
    let scene = read(inputs, &options)?;
    for warning in &scene.warnings {
        complain(&format!("warning: {warning}"));
    }
    Ok(scene)
}

pub fn build(arguments: &arguments::BuildCity) -> Result<Report> {
    let start = Instant::now();
    let scene = read_scene(&arguments.inputs, arguments.facades)?;
    let base = Base::new(&scene, arguments.ground.as_deref())?;
    let options = CityOptions {
        bake: BakeOptions {
            views: arguments.views,
            has_16_bits: arguments.heights == 16,
            ..BakeOptions::of(arguments.k as usize)
        },
        leaf_side: arguments.leaf.unwrap_or_default(),
        memory: arguments.memory.map(|mebibytes| mebibytes << 20),
        threads: arguments.threads,
    };
    let height = |place: [f64; 2]| base.height(place);
    let ground = Ground {
        height: &height,
        spacing: base.spacing(),
        colour: BARE_GROUND,
    };
    let progress = start_progress("building", &arguments.output)?;
    let mut step = |done, total| progress.step(done, total);
    let built = build_city(&scene, &ground, &options, &arguments.output, &mut step)?;
    let seconds = start.elapsed().as_secs_f64();
    let baked = built.baked;
    let hidden = baked.hidden_pixels as f64 / baked.seen_pixels.max(1) as f64;
    Ok(Report::default()
        .with("blocks", built.blocks)
        .with("leaves", built.leaves)
        .with("levels", built.levels)
        .with("bytes", built.bytes)
        .with("seconds", seconds)
        .with("seconds_per_block", seconds / built.blocks as f64)
        .with("triangles", scene.triangles.len())
        .with("wall_texels", baked.wall_texels)
        .with("unassigned_wall_texels", baked.unassigned_wall_texels)
        .with("hidden_share", hidden)
        .with("warnings", scene.warnings.len())
        .with("peak_memory_bytes", peak_memory_bytes()))
}

pub fn render(arguments: &arguments::RenderCity) -> Result<Report> {
    let city = Arc::new(City::open(&arguments.file, Access::Map)?);
    let scene = match &arguments.against[..] {
        [] => None,
        inputs => Some(read_scene(inputs, arguments.facades)?),
    };
    let base = scene
        .as_ref()
        .map(|scene| Base::new(scene, None))
        .transpose()?;
    let meet = |ray: &Ray| base.as_ref().and_then(|base| base.meet(ray));
    let original = scene.as_ref().map(|scene| Original {
        scene,
        ground: &meet,
        ground_colour: BARE_GROUND,
    });
    let what = Render {
        views: arguments.views,
        size: arguments.size.map(|side| side as usize),
        tolerance: arguments.tolerance,
    };
    let mut visit = Visit::new(city, 0)?;
    let progress = start_progress("rendering", &arguments.file)?;
    let mut step = |done, total| progress.step(done, total);
    let folder = &arguments.output;
    let seen = tool::render(&mut visit, original.as_ref(), &what, folder, &mut step)?;
    let like = seen.likeness;
    Ok(Report::default()
        .with("views", what.views)
        .with("psnr_mean", like.map(|like| like.psnr_mean))
        .with("psnr_min", like.map(|like| like.psnr_min))
        .with("depth_error_mean", like.map(|like| like.depth_error_mean))
        .with(
            "psnr_rings",
            like.map(|like| like.rings.map(|[psnr, _]| psnr).to_vec()),
        )
        .with(
            "depth_error_rings",
            like.map(|like| like.rings.map(|[_, depth]| depth).to_vec()),
        )
        .with("holes", seen.holes)
        .with("rays", seen.rays)
        .with("rays_per_second", seen.rays_per_second))
}

pub fn info(city: &City) -> Report {
    let (tree, header) = (city.tree(), city.store().header());
    Report::default()
        .with("kind", "city")
        .with("cells", city.side_texels())
        .with("blocks", tree.nodes.len())
        .with("leaves", tree.leaves())
        .with("levels", tree.depth() + 1)
        .with("bytes", city.store().file_bytes())
        .with("payload_bytes", city.store().payload_bytes())
        .with("corner", tree.corner.to_vec())
        .with("side", tree.side)
        .with("floor", tree.floor)
        .with("height_min", header.sample_min)
        .with("height_max", header.sample_max)
        .with("crs", header.raster.crs.as_str())
}

pub fn verify(city: &City, file: &Path) -> Result<Outcome> {
    let progress = start_progress("verifying", file)?;
    let mut step = |done, total| progress.step(done, total);
    let damage = tool::verify_city(city, &mut step)?;
    let failure = damage
        .first()
        .map(|first| format!("{} damaged blocks: {first}", damage.len()));
    let report = Report::default()
        .with("ok", damage.is_empty())
        .with("damaged_blocks", damage.len())
        .with(
            "damage",
            damage.into_iter().map(Value::from).collect::<Vec<_>>(),
        );
    Ok(Outcome { report, failure })
}

/// A city, or nothing for a file of another kind.
pub fn open_city(file: &Path) -> Result<Option<City>> {
    let store = Store::open(file, Access::Map)?;
    match store.header().kind {
        Kind::City => City::of_store(store).map(Some),
        _ => Ok(None),
    }
}

/// The BlockMap of a node as an image.
pub fn extract(file: &Path, node: u32, output: &Path) -> Result<Report> {
    let map = City::open(file, Access::Map)?.read(node)?;
    write_png(&map, output)?;
    Ok(Report::default()
        .with("width", map.width())
        .with("height", map.side_texels)
        .with("slices", map.slices))
}
