//! What can be said on the command line.

use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand, ValueEnum};
use kimberlite::build::source::{SourceOptions, parse_raw_shape};
use kimberlite::geo::SampleType;
use std::path::{Path, PathBuf};

/// Compressed, crack-free, multiresolution terrains in one file.
#[derive(Parser)]
#[command(name = "kmb", version)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
    /// Print one JSON object instead of text
    #[arg(long, global = true)]
    pub json: bool,
}

#[derive(Subcommand)]
pub enum Command {
    /// Make a repository out of a raster
    Build(Build),
    /// Say what a repository holds
    Info { file: PathBuf },
    /// Check a repository, and its distance from its input
    Verify {
        file: PathBuf,
        /// The rasters that it was built from
        #[arg(long, num_args = 1.., value_name = "IN")]
        against: Vec<PathBuf>,
        /// The repository of heights onto which it was resampled
        #[arg(long, value_name = "H.kmb", requires = "against")]
        domain_of: Option<PathBuf>,
        #[command(flatten)]
        source: Source,
    },
    /// Write a repository without what is damaged: there it stays coarse
    Repair {
        file: PathBuf,
        /// The repaired repository; by default it takes the place of the damaged one
        #[arg(short, long, value_name = "OUT")]
        output: Option<PathBuf>,
    },
    /// Replace the samples of a region of a repository
    Update(Update),
    /// Write a level of a repository as a GeoTIFF
    Extract(Extract),
    /// Measure a flight over a repository, and look for cracks
    Fly(Fly),
    /// Measure how fast blocks are read and decoded
    Bench { file: PathBuf },
    /// Remove what unfinished builds of an output left beside it; not while one is running
    Clean { output: PathBuf },
    /// Make a city of BlockMaps out of buildings
    BuildCity(BuildCity),
    /// Make pictures of a city by rays, and compare them with what it was built from
    RenderCity(RenderCity),
    /// The height at a place in the raster's reference system
    #[command(allow_negative_numbers = true)]
    Height { file: PathBuf, x: f64, y: f64 },
}

impl Command {
    /// The file that an error without a place of its own is about.
    pub fn subject(&self) -> &Path {
        match self {
            Command::Build(build) => build.inputs.first().unwrap_or(&build.output),
            Command::Update(update) => &update.file,
            Command::Extract(extract) => &extract.file,
            Command::Fly(fly) => &fly.file,
            Command::Clean { output } => output,
            Command::BuildCity(build) => build.inputs.first().unwrap_or(&build.output),
            Command::RenderCity(render) => &render.file,
            Command::Info { file }
            | Command::Verify { file, .. }
            | Command::Repair { file, .. }
            | Command::Bench { file }
            | Command::Height { file, .. } => file,
        }
    }
}

#[derive(Args)]
pub struct Build {
    /// GeoTIFF, 16-bit PNG, SRTM .hgt, ESRI ASCII grid, .bil with .hdr, or --raw; with --colour RGB GeoTIFF, PNG
    /// or JPEG; several make a mosaic
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// The repository to write
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Largest error of any sample, in the raster's own units, of red, green and blue each; 0 is lossless
    #[arg(
        long,
        value_name = "E",
        value_parser = error_limit,
        allow_hyphen_values = true,
        required_unless_present = "rms",
        conflicts_with = "rms"
    )]
    pub max_error: Option<f64>,
    /// Instead, with --transform lifted: largest root mean square error, in the raster's own units, over red,
    /// green and blue
    #[arg(long, value_name = "R", value_parser = error_limit, allow_hyphen_values = true)]
    pub rms: Option<f64>,
    /// How samples become coefficients: interpolating by default, but lifted for colours that are lossless or
    /// have an RMS error
    #[arg(long, value_enum)]
    pub transform: Option<Transform>,
    /// How coefficients become bits
    #[arg(long, value_enum, default_value = "rans")]
    pub entropy: Entropy,
    /// How coefficients are predicted, with --entropy rans; adaptive by default for interpolating and for colours
    #[arg(long, value_enum)]
    pub prediction: Option<Prediction>,
    /// A repository whose weights and tables to use instead of training new ones
    #[arg(long, value_name = "F.kmb")]
    pub tables_from: Option<PathBuf>,
    /// Cells along a diamond's side
    #[arg(long, value_enum, default_value = "64")]
    pub cells: Cells,
    /// Memory that the build may take; what does not fit goes to temporary files beside the output [default: no limit]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..1 << 40))]
    pub memory: Option<u64>,
    /// Number of threads; 0 uses all processors
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    /// The input has colours, not heights
    #[arg(long)]
    pub colour: bool,
    /// With --colour: a repository of heights, onto whose samples and between them the image is resampled
    #[arg(long, value_name = "H.kmb", requires = "colour")]
    pub domain_of: Option<PathBuf>,
    #[command(flatten)]
    pub source: Source,
}

impl Build {
    pub fn transform(&self) -> Transform {
        let is_lifted = self.colour && self.max_error.is_none_or(|max_error| max_error == 0.0);
        self.transform.unwrap_or(match is_lifted {
            true => Transform::Lifted,
            false => Transform::Interpolating,
        })
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Transform {
    /// Point samples on every level, each within the maximum error
    Interpolating,
    /// A wavelet on filtered levels: lossless, or with an RMS error
    Lifted,
    /// Filtered levels, each within the maximum error of the filtered data
    TwoStage,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Entropy {
    /// A quadtree of Elias gamma codes
    Gamma,
    /// Interleaved rANS in contexts, with tables trained on the input
    Rans,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Prediction {
    /// Trained on the input, unless its own rule takes fewer bytes
    Adaptive,
    /// The transform's own rule
    Fixed,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Cells {
    #[value(name = "16")]
    Cells16 = 4,
    #[value(name = "32")]
    Cells32 = 5,
    #[value(name = "64")]
    Cells64 = 6,
    #[value(name = "128")]
    Cells128 = 7,
}

/// What an input leaves unsaid.
#[derive(Args)]
pub struct Source {
    /// Distance between samples, where the input has no georeference
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    spacing: Option<f64>,
    /// Two corners of the whole raster, outer edge to outer edge, where the input has no georeference
    #[arg(long, num_args = 4, value_names = ["X0", "Y0", "X1", "Y1"], allow_negative_numbers = true)]
    bounds: Option<Vec<f64>>,
    /// Physical height of one unit of the samples
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    scale: Option<f64>,
    /// The value of samples without data
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    nodata: Option<f64>,
    /// The input is nothing but little-endian samples: width, height and u8, i8, ... f32 or f64
    #[arg(long, value_name = "WxHxTYPE", value_parser = raw_shape)]
    raw: Option<(u32, u32, SampleType)>,
}

impl Source {
    /// What is said of heights, or of colours.
    pub fn options(&self, colour: bool) -> SourceOptions {
        let bounds = match self.bounds.as_deref() {
            Some(&[x0, y0, x1, y1]) => Some([x0, y0, x1, y1]),
            _ => None,
        };
        SourceOptions {
            colour,
            spacing: self.spacing,
            bounds,
            scale: self.scale,
            nodata: self.nodata,
            raw: self.raw,
        }
    }
}

#[derive(Args)]
pub struct Update {
    /// The repository, which the updated one takes the place of
    pub file: PathBuf,
    /// Two corners of the region in the raster's reference system: the samples in that box get new values
    #[arg(long, num_args = 4, value_names = ["X0", "Y0", "X1", "Y1"], allow_negative_numbers = true, required = true)]
    pub region: Vec<f64>,
    /// Rasters with the new samples; where the repository is not lossless, with all others too. Several make a
    /// mosaic, in which later ones lie over earlier ones
    #[arg(required = true, value_name = "IN")]
    pub sources: Vec<PathBuf>,
    /// The RMS error that the repository was built with, if it was built with one
    #[arg(long, value_name = "R", value_parser = error_limit, allow_hyphen_values = true)]
    pub rms: Option<f64>,
    /// Memory that the update may take where all must be built again [default: no limit]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..1 << 40))]
    pub memory: Option<u64>,
    /// Number of threads; 0 uses all processors
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
    #[command(flatten)]
    pub source: Source,
}

#[derive(Args)]
pub struct Extract {
    pub file: PathBuf,
    /// The GeoTIFF to write, of a city's block the PNG
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// The BlockMap of a node of a city, 0 for the root
    #[arg(long, value_name = "N", conflicts_with_all = ["level", "bbox"])]
    pub block: Option<u32>,
    /// An even level; the finest by default, every two levels less double the distance between samples
    #[arg(long, value_name = "L")]
    pub level: Option<u32>,
    /// Two corners of a box in the raster's reference system
    #[arg(long, num_args = 4, value_names = ["X0", "Y0", "X1", "Y1"], allow_negative_numbers = true)]
    pub bbox: Option<Vec<f64>>,
}

#[derive(Args)]
pub struct Fly {
    pub file: PathBuf,
    /// A repository of colours over the same domain, as textures
    #[arg(long, value_name = "FILE")]
    pub colour: Option<PathBuf>,
    /// With --colour: how large texels may be on the screen, in pixels
    #[arg(long, value_name = "PX", default_value_t = 1.0, requires = "colour")]
    pub texel_pixels: f64,
    /// Levels of detail beyond the finest heights, an even number
    #[arg(long, value_name = "LEVELS", default_value_t = 0)]
    pub detail: u32,
    /// With --detail: the most that a vertex is moved, as a part of the edge that it divides
    #[arg(long, value_name = "PART", default_value_t = 0.0, requires = "detail")]
    pub roughness: f64,
    /// Number of frames
    #[arg(long, default_value_t = 600)]
    pub frames: u32,
    /// Width and height of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x1024", value_parser = size)]
    pub size: [u32; 2],
    /// Largest error on screen, in pixels
    #[arg(
        long,
        value_name = "PX",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub tolerance: f64,
    /// What the tolerance is about
    #[arg(long, value_enum, default_value_t = Metric::Geometric)]
    pub metric: Metric,
    /// Threads that decode, at most 64; with 0, frames decode for themselves
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(..=64))]
    pub threads: u8,
    /// Time for refinement in a frame, in microseconds; unlimited by default
    #[arg(long, value_name = "N")]
    pub budget_us: Option<u64>,
}

#[derive(Args)]
pub struct BuildCity {
    /// CityJSON (.json, .jsonl), OBJ or glTF; several make one city
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    /// The city to write
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Texels along a block
    #[arg(long, value_enum, default_value = "128")]
    pub k: SideTexels,
    /// Walls without textures get windows, by this seed
    #[arg(long, value_name = "SEED")]
    pub facades: Option<u32>,
    /// A repository of heights that the city stands on, in the same world coordinates
    #[arg(long, value_name = "F.kmb")]
    pub ground: Option<PathBuf>,
    /// Memory that triangles and textures may take [default: no limit]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..1 << 40))]
    pub memory: Option<u64>,
    /// Longest edge of the smallest blocks, in metres [default: 64]
    #[arg(long, value_name = "METRES")]
    pub leaf: Option<f64>,
    /// Views from which the walls of a block are painted
    #[arg(long, default_value_t = 64)]
    pub views: usize,
    /// Bits of a height: 8 or 16
    #[arg(long, value_name = "BITS", default_value_t = 8, value_parser = clap::builder::PossibleValuesParser::new(["8", "16"]).map(|bits| if bits == "16" { 16u8 } else { 8 }))]
    pub heights: u8,
    /// Number of threads; 0 uses all processors
    #[arg(long, default_value_t = 0)]
    pub threads: usize,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum SideTexels {
    #[value(name = "32")]
    Texels32 = 32,
    #[value(name = "64")]
    Texels64 = 64,
    #[value(name = "128")]
    Texels128 = 128,
}

#[derive(Args)]
pub struct RenderCity {
    pub file: PathBuf,
    /// Number of views, on three rings around the city
    #[arg(long, default_value_t = 9)]
    pub views: usize,
    /// Width and height of a picture in pixels
    #[arg(long, value_name = "WxH", default_value = "640x512", value_parser = size)]
    pub size: [u32; 2],
    /// What the city was built from
    #[arg(long, num_args = 1.., value_name = "IN")]
    pub against: Vec<PathBuf>,
    /// With --against: the seed of its facades
    #[arg(long, value_name = "SEED", requires = "against")]
    pub facades: Option<u32>,
    /// Largest error of a block on the screen, in pixels; 0 for the finest blocks
    #[arg(long, value_name = "PX", default_value_t = 0.0)]
    pub tolerance: f64,
    /// The folder for the pictures
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Metric {
    /// How far the ground may be from where the finest surface has it
    Geometric,
    /// How large triangles may be
    Sampling,
}

fn error_limit(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if number >= 0.0 && number.is_finite() {
        return Ok(number);
    }
    Err("must be a finite number from 0 up".to_owned())
}

fn raw_shape(text: &str) -> Result<(u32, u32, SampleType), String> {
    parse_raw_shape(text).map_err(|error| error.to_string())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = |text: &str| text.parse::<u32>().ok().filter(|&pixels| pixels > 0);
    let sides = text
        .split_once('x')
        .and_then(|(w, h)| Some([parse(w)?, parse(h)?]));
    sides.ok_or_else(|| "expected WxH, as in 1280x1024".to_owned())
}
