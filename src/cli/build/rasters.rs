//! Options of `spinney build` for rasters and volumes.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, bail};
use spinney::import::raster::{ImportOptions, StackOptions};
use spinney::import::volume::VolumeOptions;
use spinney::raw::import::raster::Band;
use spinney::raw::import::volume::{RawLayout, VolumeInput, is_volume};
use spinney::{DataKind, Number, Resampling, Rule, SampleType, WarpOptions};

use super::super::args::numbers;
use super::Common;

/// Options for rasters, some of them for volumes, too.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct RasterArgs {
    /// Meaning of the values: categorical (classes, counted) or continuous (averaged) [default:
    /// from the file]
    #[arg(long)]
    pub(super) kind: Option<DataKind>,
    /// Rule for representative values at coarse detail: mean, majority, dominant, min, max or
    /// nearest [default: mean of continuous values, majority of classes]
    #[arg(long)]
    pub(super) rule: Option<Rule>,
    /// Channels to use, by number from 1 or by name (in full, or up to a comma), in this order
    /// [default: all]
    #[arg(long, value_name = "N|NAME,...", value_delimiter = ',')]
    band: Option<Vec<Band>>,
    /// Nodata number: pixels equal to it become VOID [default: from the file]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    nodata: Option<Number>,
    /// Coordinates of the pixels: x = a col + b row + c, y = d col + e row + f [default: from the
    /// file]. Volumes: widths of a cell along x, y and z, or a 3 x 4 matrix, row by row [default:
    /// 1,1,1]
    #[arg(long, value_name = "a,b,c,d,e,f", value_parser = parse_transform)]
    pub(super) transform: Option<Transform>,
    /// Layer of a file that has several: of an OpenEXR file [default: the first], or of a
    /// GeoPackage
    #[arg(long, value_name = "NAME")]
    pub(super) layer: Option<String>,
    /// Pages of a TIFF file that has several: one by its number from 0, or all of them, as layers
    /// of a stack or (z) as planes of a volume; z also accepts image files and directories, each
    /// image a plane, in the order of the numbers in their names (natural sort; signs, decimals and
    /// units of length count, missing numbers are reported)
    #[arg(long, value_name = "layers|z|N")]
    pages: Option<Pages>,
    /// Cells along x, y and z of a volume in a raw file of samples: x fastest; and samples per
    /// cell, if there are several
    #[arg(long, value_name = "X,Y,Z[,CHANNELS]", value_parser = parse_raw, requires = "raw_type")]
    raw_size: Option<RawSize>,
    /// Sample type of the raw file: u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64
    #[arg(long, value_name = "TYPE", value_parser = parse_sample, requires = "raw_size")]
    raw_type: Option<SampleType>,
    /// Bytes of the file before the first sample [default: 0]
    #[arg(long, value_name = "BYTES", requires = "raw_size")]
    raw_skip: Option<u64>,
    /// Samples are big-endian
    #[arg(long, requires = "raw_size")]
    big_endian: bool,
    /// Keep the inputs, and each of their bands, as layers of one file; colour images are one
    /// layer. All have the same origin; cell widths are integer multiples of the finest
    #[arg(long)]
    stack: bool,
    /// Names of the layers of a stack [default: those of the files; of files with several bands
    /// those of the bands]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    names: Option<Vec<String>>,
    /// Acquisition times of the layers of a stack, as in 2024-05-31 or 2024-05-31T10:30:00Z: of
    /// each layer, or of each file
    #[arg(long, value_name = "TIME,...", value_delimiter = ',')]
    times: Option<Vec<String>>,
    /// Keep pixels of opacity 0 as cells with their colours: coarser cells average them like all
    /// others [default: they are VOID]
    #[arg(long)]
    keep_transparent: bool,
    /// Zoom whose tiles of 256 x 256 cells are the deepest; with --grid xyz [default: that whose
    /// cells are closest in size to the raster's pixels, at its centre]
    #[arg(long, value_name = "Z")]
    pub(super) max_zoom: Option<u8>,
    /// Resampling, with --grid or --stack (of files that have other grids than the finest):
    /// nearest, bilinear, cubic, area or majority [default: nearest for classes, bilinear for
    /// continuous values; majority or area where cells are more than 1.5 times as large as pixels]
    #[arg(long, value_name = "WAY")]
    resampling: Option<Resampling>,
    /// Treat datums as WGS 84 if their shift is unknown or needs a grid; with --grid or --stack.
    /// Errors are up to some hundreds of metres
    #[arg(long)]
    allow_ballpark: bool,
}

/// Cells along x, y and z, and samples per cell.
type RawSize = ([u64; 3], u8);

/// Parses the size of a raw volume.
fn parse_raw(text: &str) -> Result<RawSize, &'static str> {
    let numbers: Option<Vec<u64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some([x, y, z]) => Ok(([*x, *y, *z], 1)),
        Some([x, y, z, channels @ 1..=4]) => Ok(([*x, *y, *z], *channels as u8)),
        _ => Err("expected cells along x, y and z, such as 512,512,300, and up to 4 channels"),
    }
}

/// Parses the name of a sample type.
fn parse_sample(text: &str) -> Result<SampleType, &'static str> {
    let named = SampleType::ALL.into_iter().find(|sample| sample.name() == text);
    named.ok_or("expected u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64")
}

/// Pages of a TIFF file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::cli) enum Pages {
    /// All, as layers.
    Layers,
    /// All, as planes of a volume.
    Volume,
    /// One, by its number from 0.
    One(usize),
}

impl FromStr for Pages {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Pages, &'static str> {
        match text {
            "layers" => Ok(Pages::Layers),
            "z" => Ok(Pages::Volume),
            _ => text.parse().map(Pages::One).map_err(|_| "expected layers, z, or a number from 0"),
        }
    }
}

/// Coordinates of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Transform {
    Raster([f64; 6]),
    Volume([[f64; 4]; 3]),
}

impl RasterArgs {
    /// Returns the first given option: solids reject them.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--kind", self.kind.is_some()),
            ("--rule", self.rule.is_some()),
            ("--transform", self.transform.is_some()),
        ];
        let given = given.into_iter().find(|(_, given)| *given).map(|(name, _)| name);
        given.or(self.of_cells()).or(self.of_warping()).or(self.of_stacks())
    }

    /// Fails if one of these options was given for an input that becomes a solid.
    pub(super) fn refuse(&self, input: &Path) -> Result<()> {
        match self.given() {
            Some(option) => {
                bail!(
                    "{option}: works only with rasters and volumes, {} is a model of a solid",
                    input.display()
                )
            }
            None => Ok(()),
        }
    }

    /// Returns the inputs as a volume, if they are one.
    pub(in crate::cli) fn volume_input(&self, inputs: &[PathBuf]) -> Result<Option<VolumeInput>> {
        let raw = self.raw_layout();
        if self.pages == Some(Pages::Volume) {
            if raw.is_some() {
                bail!(
                    "--pages and --raw-size: got both, expected one; --raw-size is for files of samples without a header"
                );
            }
            return Ok(Some(VolumeInput::Sections(inputs.to_vec())));
        }
        if raw.is_none() && !inputs.iter().any(|input| is_volume(input)) {
            return Ok(None);
        }
        let [input] = inputs else {
            bail!(
                "got {} inputs, expected one volume (NPY, NRRD, or --raw-size); `spinney combine over` merges trees",
                inputs.len()
            )
        };
        let input = input.clone();
        Ok(Some(match raw {
            Some(layout) => VolumeInput::Raw(input, layout),
            None => VolumeInput::File(input),
        }))
    }

    /// Returns the layout of a raw file of samples.
    fn raw_layout(&self) -> Option<RawLayout> {
        let ((size, channels), sample) = self.raw_size.zip(self.raw_type)?;
        let mut layout = RawLayout::new(size, sample);
        (layout.channels, layout.is_big_endian) = (channels, self.big_endian);
        layout.skip = self.raw_skip.unwrap_or(0);
        Some(layout)
    }

    /// Returns the first given option for stacks.
    pub(in crate::cli) fn of_stacks(&self) -> Option<&'static str> {
        let given = [
            ("--stack", self.stack),
            ("--pages layers", self.pages == Some(Pages::Layers)),
            ("--names", self.names.is_some()),
            ("--times", self.times.is_some()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Returns the first given option that selects the input's samples.
    pub(super) fn of_cells(&self) -> Option<&'static str> {
        let given = [
            ("--band", self.band.is_some()),
            ("--nodata", self.nodata.is_some()),
            ("--layer", self.layer.is_some()),
            ("--pages", self.pages.is_some()),
            ("--raw-size", self.raw_size.is_some()),
            ("--keep-transparent", self.keep_transparent),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Returns the kind of the values and the rule for coarser cells, if given.
    pub(super) fn kind_and_rule(&self) -> (Option<DataKind>, Option<Rule>) {
        (self.kind, self.rule)
    }

    /// Returns the first given option for warping to another grid.
    pub(in crate::cli) fn of_warping(&self) -> Option<&'static str> {
        let given = [
            ("--max-zoom", self.max_zoom.is_some()),
            ("--resampling", self.resampling.is_some()),
            ("--allow-ballpark", self.allow_ballpark),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Returns the options for warping.
    pub(super) fn warp_options(&self) -> WarpOptions {
        let mut options = WarpOptions::default();
        (options.resampling, options.allow_ballpark) = (self.resampling, self.allow_ballpark);
        options
    }

    /// Returns the options for importing a raster.
    pub(in crate::cli) fn import_options(&self, common: &Common) -> Result<ImportOptions> {
        let RasterArgs { kind, rule, band, nodata, transform, layer, pages, keep_transparent, .. } =
            self.clone();
        let Common { depth, crs, memory, share, time, .. } = common;
        let mut options = ImportOptions::new();
        options.access = common.access.clone();
        (options.kind, options.rule, options.bands, options.nodata) = (kind, rule, band, nodata);
        (options.depth, options.crs, options.share, options.time) = (*depth, crs.clone(), *share, *time);
        options.layer = layer;
        options.page = match pages {
            Some(Pages::One(page)) => Some(page),
            _ => None,
        };
        options.transform = match transform {
            None => None,
            Some(Transform::Raster(numbers)) => Some(numbers),
            Some(Transform::Volume(_)) => bail!("--transform: expected 6 numbers for a raster: a,b,c,d,e,f"),
        };
        options.keep_transparent = keep_transparent;
        options.packing = common.packing.choice();
        options.memory = Some(memory.bytes);
        Ok(options)
    }

    /// Returns options for a stack, if one is requested, or if the bands of the only input cannot
    /// form one value.
    pub(in crate::cli) fn stack_options(
        &self,
        inputs: &[PathBuf],
        common: &Common,
    ) -> Result<Option<StackOptions>> {
        let every_page = self.pages == Some(Pages::Layers);
        if !self.stack && !every_page {
            let is_single = common.grid.is_some() || self.of_warping().is_some();
            let import = self.import_options(common)?;
            if is_single || !spinney::raw::import::raster::needs_layers(inputs, &import)? {
                if self.names.is_some() || self.times.is_some() {
                    bail!("--names and --times: work only with --stack")
                }
                return Ok(None);
            }
        }
        if common.grid.is_some() || self.max_zoom.is_some() {
            bail!(
                "--stack: layers have the grid of the finest file; --grid and --max-zoom work only with single rasters"
            )
        }
        let mut options = StackOptions::new();
        options.import = self.import_options(common)?;
        (options.names, options.times) = (self.names.clone(), self.times.clone());
        options.every_page = every_page;
        (options.resampling, options.allow_ballpark) = (self.resampling, self.allow_ballpark);
        Ok(Some(options))
    }

    /// Returns the options for importing a volume.
    pub(in crate::cli) fn volume_options(&self, common: &Common) -> Result<VolumeOptions> {
        let RasterArgs { kind, rule, band, nodata, transform, layer, pages, keep_transparent, .. } = self;
        let Common { depth, crs, memory, share, time, grid, .. } = common;
        if band.is_some()
            || layer.is_some()
            || pages.is_some_and(|pages| pages != Pages::Volume)
            || *keep_transparent
            || grid.is_some()
            || self.of_warping().is_some()
        {
            bail!(
                "--band, --layer, --pages, --keep-transparent and --grid with its options: have no effect on volumes"
            );
        }
        let mut options = VolumeOptions::new();
        options.access = common.access.clone();
        (options.kind, options.rule, options.nodata) = (*kind, *rule, *nodata);
        (options.depth, options.crs, options.share, options.time) = (*depth, crs.clone(), *share, *time);
        options.transform = match *transform {
            None => None,
            Some(Transform::Volume(matrix)) => Some(matrix),
            Some(Transform::Raster(_)) => {
                bail!(
                    "--transform: expected 3 numbers for a volume, the widths of a cell, or 12, a 3 x 4 matrix"
                )
            }
        };
        options.packing = common.packing.choice();
        options.memory = Some(memory.bytes);
        Ok(options)
    }
}

/// Parses the numbers of a transform.
fn parse_transform(text: &str) -> Result<Transform, String> {
    if let Some([x, y, z]) = numbers(text) {
        return Ok(Transform::Volume([[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]]));
    }
    if let Some([a, b, c, d, e, f, g, h, i, j, k, l]) = numbers(text) {
        return Ok(Transform::Volume([[a, b, c, d], [e, f, g, h], [i, j, k, l]]));
    }
    let planar = numbers(text).map(Transform::Raster);
    planar.ok_or_else(|| "expected 6 numbers: a,b,c,d,e,f; for volumes 3 or 12".into())
}
