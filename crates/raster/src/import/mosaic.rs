//! Mosaics of several rasters on one grid.

use std::path::{Path, PathBuf};

use super::ahead::{MappedRaster, PixelMapping, prefetch_mapped};
use super::provenance::mosaic_layout;
use super::validity::Validity;
use super::{Order, Pixels, Raster, RasterInfo, SourceWindows};
use crate::index::SourceWindow;
use serde::{Deserialize, Serialize};
use spinney_base::space::Region;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};
use spinney_references::{PixelRule, paint};

/// Maximum distance of a raster's pixels from the grid of the first raster, in pixels.
const TOLERANCE: f64 = 1e-3;

/// A mosaic of several rasters on one grid.
pub(super) struct Mosaic {
    /// Path of the first file, for messages.
    path: PathBuf,
    inputs: Vec<Input>,
    info: RasterInfo,
    /// Whether inputs have different nodata numbers, so that VOID pixels need flags.
    flag_all: bool,
    part: Pixels,
}

struct Input {
    raster: Box<dyn Raster>,
    /// Region of its pixels in the mosaic.
    region: Region,
    validity: Validity,
}

/// Combines several rasters into one that covers all of them. The last raster is on top; where it
/// is VOID, those below are visible.
///
/// Pixels must have the same type, and must be on one grid. All other properties (palette, names,
/// tags) are those of the first raster. If nodata numbers differ, the mosaic has none and flags
/// VOID pixels instead. A single raster is returned unchanged.
///
/// # Errors
/// If the rasters do not fit together, or there are none.
pub fn mosaic(mut rasters: Vec<Box<dyn Raster>>) -> Result<Box<dyn Raster>> {
    match rasters.len() {
        0 => Err(Error::invalid("inputs", "none", "at least one raster")),
        1 => Ok(rasters.remove(0)),
        _ => Ok(Box::new(Mosaic::of(rasters)?)),
    }
}

/// Description of a mosaic with known inputs. With it a region of the mosaic can be built from only
/// the inputs that intersect the region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct MosaicPlan {
    /// Columns and rows.
    pub size: [u64; 2],
    /// The number that marks missing samples, unless inputs have different ones.
    #[serde(with = "spinney_base::text_fields")]
    pub nodata: Option<Number>,
    /// Whether inputs have different nodata numbers.
    pub flag_all: bool,
    /// Region of each input's pixels.
    pub regions: Vec<Region>,
}

impl MosaicPlan {
    /// A mosaic of columns and rows, without inputs.
    pub fn new(size: [u64; 2], nodata: Option<Number>, flag_all: bool) -> MosaicPlan {
        MosaicPlan { size, nodata, flag_all, regions: Vec::new() }
    }
}

impl Mosaic {
    /// Computes the mosaic of several rasters.
    pub(super) fn of(rasters: Vec<Box<dyn Raster>>) -> Result<Mosaic> {
        let first = &*rasters[0];
        let of =
            |raster: &dyn Raster| grid_offset((first.info(), first.path()), (raster.info(), raster.path()));
        let offsets = rasters.iter().map(|raster| of(&**raster)).collect::<Result<Vec<_>>>()?;
        let corner: [i64; 2] =
            std::array::from_fn(|axis| offsets.iter().map(|offset| offset[axis]).min().unwrap_or(0));
        let mut info = first.info().clone();
        let first_cell = Frame::identity().shifted([corner[0] as f64, corner[1] as f64, 0.0]);
        info.frame = info.frame.shifted([corner[0] as f64, corner[1] as f64, 0.0]);
        info.control_points = info.control_points.and_then(|points| points.seen_through(&first_cell));
        let flag_all = rasters.iter().any(|raster| !same_number(raster.info().nodata, info.nodata));
        if flag_all {
            info.nodata = None;
        }
        if rasters.iter().any(|raster| raster.info().order == Order::Bands) {
            info.order = Order::Bands;
        }
        info.layout = mosaic_layout(rasters.len(), &info.layout);
        let input = |(raster, offset): (Box<dyn Raster>, [i64; 2])| {
            let found = raster.info();
            let (x, y) = ((offset[0] - corner[0]) as u64, (offset[1] - corner[1]) as u64);
            Input {
                region: Region::new(x, y, found.width, found.height),
                validity: Validity::by_all(found),
                raster,
            }
        };
        let mut inputs: Vec<Input> = rasters.into_iter().zip(offsets).map(input).collect();
        info.width = inputs.iter().map(|input| input.region.right()).max().unwrap_or(0);
        info.height = inputs.iter().map(|input| input.region.bottom()).max().unwrap_or(0);
        let path = inputs[0].raster.path().to_path_buf();
        inputs.iter_mut().for_each(|input| input.raster.forget_properties());
        Ok(Mosaic { path, inputs, info, flag_all, part: Pixels::default() })
    }

    /// A planned mosaic restricted to these inputs, possibly none. `empty` describes its pixels if
    /// there are none.
    ///
    /// # Errors
    /// If an input's size differs from the plan, or its pixels have another type.
    pub(super) fn placed(
        plan: &MosaicPlan,
        rasters: Vec<Box<dyn Raster>>,
        (path, empty): (&Path, RasterInfo),
    ) -> Result<Mosaic> {
        let mut info = rasters.first().map_or(empty, |first| first.info().clone());
        let pixels = |info: &RasterInfo| (info.sample, info.channels, info.alpha);
        let mut inputs = Vec::with_capacity(rasters.len());
        for (raster, region) in rasters.into_iter().zip(&plan.regions) {
            let found = raster.info();
            if [found.width, found.height] != [region.width, region.height] || pixels(found) != pixels(&info)
            {
                return Err(Error::Changed { path: raster.path().to_path_buf(), what: "was overwritten" });
            }
            inputs.push(Input { region: *region, validity: Validity::by_all(found), raster });
        }
        [info.width, info.height] = plan.size;
        (info.nodata, info.order) = (plan.nodata, Order::Anywhere);
        if inputs.iter().any(|input| input.raster.info().order == Order::Bands) {
            info.order = Order::Bands;
        }
        Ok(Mosaic {
            path: path.to_path_buf(),
            inputs,
            info,
            flag_all: plan.flag_all,
            part: Pixels::default(),
        })
    }

    /// Returns the plan of this mosaic.
    pub(super) fn plan(&self) -> MosaicPlan {
        MosaicPlan {
            size: [self.info.width, self.info.height],
            nodata: self.info.nodata,
            flag_all: self.flag_all,
            regions: self.inputs.iter().map(|input| input.region).collect(),
        }
    }
}

fn same_number(a: Option<Number>, b: Option<Number>) -> bool {
    a.map(Number::with_plain_zero) == b.map(Number::with_plain_zero)
        || matches!((a, b), (Some(a), Some(b)) if a.is_nan() && b.is_nan())
}

/// Offset of a raster's first pixel in pixels of another raster, given their properties and paths.
pub(crate) fn grid_offset(first: (&RasterInfo, &Path), other: (&RasterInfo, &Path)) -> Result<[i64; 2]> {
    let ((a, first), (b, other)) = (first, other);
    let both = || format!("mosaic of {} and {}", first.display(), other.display());
    let pixels = |info: &RasterInfo| (info.sample, info.channels, info.alpha);
    if pixels(a) != pixels(b) || a.scale_offset != b.scale_offset {
        let name = |info: &RasterInfo| {
            let alpha = if info.alpha.is_some() { " with opacity" } else { "" };
            format!("{} x {}{alpha}, scale {:?}", info.channels, info.sample.name(), info.scale_offset)
        };
        return Err(Error::invalid(
            both(),
            format!("{} and {}", name(a), name(b)),
            format!(
                "equal pixel types and scales; to convert the second, combine trees: `spinney build {} -o below.goblin`, \
                 `spinney build {} -o above.goblin`, `spinney combine over above.goblin below.goblin -o both.goblin`",
                first.display(),
                other.display()
            ),
        ));
    }
    let [here, there] = [first, other].map(|path| path.display().to_string());
    Crs::check_same((&here, a.frame.crs.as_ref()), (&there, b.frame.crs.as_ref()))?;
    // If three corners are on the grid, all pixels are.
    let (width, height) = (b.width as f64, b.height as f64);
    let shift = |[x, y]: [f64; 2]| {
        let [column, row, _] = a.frame.to_cells(b.frame.to_world([x, y, 0.0]))?;
        Some([column - x, row - y])
    };
    let expected = shift([0.0, 0.0]).map(|shift| shift.map(f64::round));
    let on_grid = |corner| match (shift(corner), expected) {
        (Some(found), Some(expected)) => {
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= TOLERANCE && b.abs() < 1e15)
        }
        _ => false,
    };
    match expected.filter(|_| [[0.0, 0.0], [width, 0.0], [0.0, height]].into_iter().all(on_grid)) {
        Some(shift) => Ok(shift.map(|pixels| pixels as i64)),
        None => {
            let found = format!("transforms {:?} and {:?}", a.frame.affine(), b.frame.affine());
            Err(Error::invalid(both(), found, "pixels of one size, an integer number of pixels apart"))
        }
    }
}

impl Raster for Mosaic {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn reads_anywhere(&self) -> bool {
        self.inputs.iter().all(|input| input.raster.reads_anywhere())
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let touched = |input: &&mut Input| !input.region.intersect(&region).is_empty();
        let mut inputs: Vec<&mut Input> = self.inputs.iter_mut().filter(touched).collect();
        // The usual case: one input covers the region.
        if let [input] = inputs.as_mut_slice()
            && input.region.contains(&region)
        {
            input.read(region, pixels)?;
            if self.flag_all {
                input.validity.apply(pixels);
            }
            return Ok(());
        }
        let size = self.info.pixel_bytes();
        pixels.bytes.clear();
        pixels.bytes.resize(region.area() as usize * size, 0);
        let mut covered = vec![false; region.area() as usize];
        // From the top down, until all pixels are known.
        for input in inputs.into_iter().rev() {
            let part = input.region.intersect(&region);
            input.read(part, &mut self.part)?;
            input.validity.apply(&mut self.part);
            for row in 0..part.height {
                let from = (row * part.width) as usize..((row + 1) * part.width) as usize;
                let to = ((part.y - region.y + row) * region.width + part.x - region.x) as usize;
                let to = to..to + from.len();
                let flags = self.part.valid.as_ref().map(|flags| &flags[from.clone()]);
                let samples = &self.part.bytes[from.start * size..from.end * size];
                let target = &mut pixels.bytes[to.start * size..to.end * size];
                paint(target, &mut covered[to], samples, flags, size);
            }
            // (Rows that are skipped cannot be read later.)
            if self.info.order == Order::Anywhere && !covered.contains(&false) {
                break;
            }
        }
        pixels.valid = covered.contains(&false).then_some(covered);
        Ok(())
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        prefetch_mapped(regions, self.inputs.iter_mut().map(Input::mapped).collect())
    }

    fn source_windows(&self) -> SourceWindows {
        let mut windows = Vec::new();
        for input in &self.inputs {
            for window in input.raster.source_windows()? {
                // Pixels of other rasters than files have been decided on already.
                if window.rule != PixelRule::default() {
                    return Err("a virtual raster among several files".into());
                }
                let rule = input.validity.rule();
                let Region { x, y, width, height } = window.cells;
                let cells = Region::new(x + input.region.x, y + input.region.y, width, height);
                windows.push(SourceWindow { rule: rule.clone(), cells, ..window });
            }
        }
        Ok(windows)
    }
}

impl Input {
    fn mapped(&mut self) -> MappedRaster<'_> {
        let origin = [self.region.x as i64, self.region.y as i64];
        MappedRaster {
            raster: &mut *self.raster,
            covers: self.region,
            mapping: PixelMapping { origin, factor: [1; 2] },
        }
    }

    /// Reads a region of the mosaic that is within the input.
    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        let Region { x, y, width, height } = region;
        self.raster.read(Region::new(x - self.region.x, y - self.region.y, width, height), pixels)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::fake::Fake;
    use super::*;
    use spinney_base::value::SampleType;

    fn info(at: [i64; 2], size: [u64; 2]) -> RasterInfo {
        let frame =
            Frame::planar([0.5, 0.0, 100.0 + 0.5 * at[0] as f64, 0.0, -0.5, 50.0 - 0.5 * at[1] as f64]);
        RasterInfo { frame, nodata: Some(0.into()), ..RasterInfo::plain(size, SampleType::U8, 1) }
    }

    /// A raster at an offset with pixels from 0 (VOID) to 3, whether it requires bands, and whether
    /// it has another nodata number.
    type TestImage = ([i64; 2], [u64; 2], Vec<u8>, bool, bool);

    fn image() -> impl Strategy<Value = TestImage> {
        let size = (1u64..9, 1u64..9);
        let offset = (-6i64..6, -6i64..6);
        (offset, size, any::<bool>(), any::<bool>()).prop_flat_map(
            |((x, y), (width, height), bands, other)| {
                let pixels = prop::collection::vec(0u8..4, (width * height) as usize);
                pixels.prop_map(move |pixels| ([x, y], [width, height], pixels, bands, other))
            },
        )
    }

    proptest! {
        #[test]
        fn a_mosaic_is_what_overlaying_gives(images in prop::collection::vec(image(), 1..5), band in 1u64..5) {
            let raster = |(at, size, pixels, bands, other): &TestImage| -> Box<dyn Raster> {
                let mut info = info(*at, *size);
                info.order = if *bands { Order::Bands } else { Order::Anywhere };
                info.nodata = Some(if *other { 3.into() } else { 0.into() });
                Box::new(Fake::new(info, pixels.clone()))
            };
            let mut mosaic = mosaic(images.iter().map(raster).collect()).unwrap();
            let info = mosaic.info().clone();
            let [west, north] = [0, 1].map(|axis| images.iter().map(|image| image.0[axis]).min().unwrap());
            prop_assert_eq!(info.frame.to_world([0.0; 3])[..2].to_vec(), vec![
                100.0 + 0.5 * west as f64,
                50.0 - 0.5 * north as f64,
            ]);
            let expected = |x: i64, y: i64| {
                images.iter().rev().find_map(|(at, size, pixels, _, other)| {
                    let (x, y) = ((x - at[0]) as u64, (y - at[1]) as u64);
                    let inside = x < size[0] && y < size[1];
                    let pixel = inside.then(|| pixels[(y * size[0] + x) as usize]);
                    pixel.filter(|pixel| *pixel != if *other { 3 } else { 0 })
                })
            };
            let mut pixels = Pixels::default();
            for y in (0..info.height).step_by(band as usize) {
                let region = Region::new(0, y, info.width, band.min(info.height - y));
                mosaic.read(region, &mut pixels).unwrap();
                for i in 0..region.area() {
                    let (column, row) = (i % info.width, y + i / info.width);
                    let pixel = pixels.bytes[i as usize];
                    let flag = pixels.valid.as_ref().is_none_or(|valid| valid[i as usize]);
                    let found = (flag && info.nodata != Some(pixel.into())).then_some(pixel);
                    prop_assert_eq!(found, expected(column as i64 + west, row as i64 + north));
                }
            }
        }
    }

    #[test]
    fn incompatible_rasters_are_rejected() {
        let refused = |change: &dyn Fn(&mut RasterInfo)| {
            let mut other = info([5, 0], [4, 4]);
            change(&mut other);
            let (pixels, size) = (vec![1; 4 * 4 * other.pixel_bytes()], other);
            let one: Box<dyn Raster> = Box::new(Fake::new(info([0, 0], [4, 4]), vec![1; 16]));
            mosaic(vec![one, Box::new(Fake::new(size, pixels))]).err().map(|error| error.to_string())
        };
        assert_eq!(refused(&|_| {}), None);
        assert_eq!(refused(&|info| info.frame.matrix[0][3] += 0.5 * 0.0009), None);
        let names = |error: Option<String>, what: &str| error.is_some_and(|error| error.contains(what));
        assert!(names(refused(&|info| info.frame.matrix[0][3] += 0.5 * 0.002), "102.5"));
        assert!(names(refused(&|info| info.frame.matrix[0][0] *= 1.001), "transforms"));
        assert!(names(refused(&|info| info.frame.matrix[1][1] *= -1.0), "transforms"));
        assert!(names(refused(&|info| info.frame.crs = Some(Crs::epsg(4326))), "EPSG:4326"));
        assert!(names(refused(&|info| info.sample = SampleType::I16), "i16"));
        assert!(names(refused(&|info| info.frame.matrix[0][3] = f64::NAN), "transforms"));
    }

    #[test]
    fn masks_of_inputs_count() {
        let below: Box<dyn Raster> = Box::new(Fake::new(info([0, 0], [2, 1]), vec![1, 2]));
        let above = Fake::new(info([0, 0], [2, 1]), vec![3, 4]).with_mask(vec![false, true]);
        let mut mosaic = mosaic(vec![below, Box::new(above)]).unwrap();
        let mut pixels = Pixels::default();
        mosaic.read(Region::new(0, 0, 2, 1), &mut pixels).unwrap();
        assert_eq!(pixels, Pixels { bytes: vec![1, 4], valid: None });
    }
}
