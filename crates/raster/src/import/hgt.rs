//! SRTM elevation tiles: raw big-endian i16 samples, georeferenced by the file name.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::{Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::io::{InputFile, without_query};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, SampleType};
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// Columns and rows of one-degree files, with spacings of 1, 3, 1/2 and 1/4 arc seconds; at high
/// latitudes also 2 or 3 arc seconds along parallels. Each size has a distinct number of bytes.
const SIZES: [[u64; 2]; 6] =
    [[3601, 3601], [1201, 1201], [1801, 3601], [1201, 3601], [7201, 7201], [14401, 14401]];

struct Hgt {
    path: PathBuf,
    file: InputFile,
    info: RasterInfo,
}

pub(super) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let file = options.access.input(path)?;
    let bytes = file.len();
    let Some([width, height]) = SIZES.into_iter().find(|[width, height]| 2 * width * height == bytes) else {
        let sizes =
            SIZES.map(|[width, height]| format!("{} ({width} x {height} samples)", 2 * width * height));
        return Err(Error::corrupt(path, "the whole file", format!("{bytes} bytes"), sizes.join(" or ")));
    };
    let name = without_query(path).file_name().unwrap_or_default().to_string_lossy();
    let [west, south] = corner(&name).ok_or_else(|| {
        let advice = "rename it to its south-west corner, as in N46E008.hgt";
        Error::unsupported(path, "an .hgt file without a position in its name", advice)
    })?;

    // Samples are points on a grid that includes both edges of the degree. The first pixel's area
    // extends half a pixel beyond it.
    let [step_x, step_y] = [width, height].map(|samples| 1.0 / (samples - 1) as f64);
    let mut frame =
        Frame::planar([step_x, 0.0, west - step_x / 2.0, 0.0, -step_y, south + 1.0 + step_y / 2.0]);
    frame.crs = Some(Crs::epsg(4326));
    frame.pixel_is_point = true;
    let info = RasterInfo {
        frame,
        nodata: Some((-32768).into()),
        kind: Some(DataKind::Continuous),
        layout: "SRTM .hgt, rows".into(),
        ..RasterInfo::plain([width, height], SampleType::I16, 1)
    };
    Ok(Box::new(Hgt { path: path.to_path_buf(), file, info }))
}

/// West and south edge in degrees, from a name that starts like `N46E008`.
fn corner(name: &str) -> Option<[f64; 2]> {
    let degrees = |at: std::ops::Range<usize>, limit: i32, negative: u8, positive: u8| {
        let digits = name.get(at.start + 1..at.end)?;
        let number: i32 = digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok())??;
        let sign = name.as_bytes()[at.start].to_ascii_uppercase();
        let number = if sign == negative { -number } else { number };
        let known = sign == negative || sign == positive;
        (known && (-limit..limit).contains(&number)).then_some(f64::from(number))
    };
    let ends_there = name.as_bytes().get(7).is_some_and(|b| !b.is_ascii_alphanumeric());
    Some([degrees(3..7, 180, b'W', b'E')?, degrees(0..3, 90, b'S', b'N')?]).filter(|_| ends_there)
}

impl Raster for Hgt {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        pixels.valid = None;
        pixels.bytes.clear();
        pixels.bytes.resize(region.area() as usize * 2, 0);
        let row_bytes = region.width as usize * 2;
        for (y, row) in (region.y..).zip(pixels.bytes.chunks_exact_mut(row_bytes.max(1))) {
            let start = (y * self.info.width + region.x) * 2;
            self.file.seek(SeekFrom::Start(start)).map_err(Error::io(&self.path, "read"))?;
            self.file.read_exact(row).map_err(Error::io(&self.path, "read"))?;
            row.as_chunks_mut::<2>().0.iter_mut().for_each(|sample| sample.reverse());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::corner;

    #[test]
    fn names() {
        assert_eq!(corner("N46E008.hgt"), Some([8.0, 46.0]));
        assert_eq!(corner("s01w122.SRTMGL1.hgt"), Some([-122.0, -1.0]));
        for name in [
            "",
            "N46E08.hgt",
            "N46E0081.hgt",
            "X46E008.hgt",
            "N4\u{e9}E008.hgt",
            "N+6E008.hgt",
            "N95E008.hgt",
        ] {
            assert_eq!(corner(name), None, "{name}");
        }
    }
}
