//! Remote files that are opened, and read ahead, at the same time.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use super::Raster;
use spinney_base::Result;
use spinney_base::io::{run_waiting, url_of};
use spinney_base::space::Region;

/// Maximum number of rasters that are announced at the same time, if several regions touch more.
const MAX_AHEAD: usize = 64;

/// Opens inputs, in their order: if one is remote, several at the same time.
///
/// # Errors
/// The error of the first input that cannot be opened.
pub(super) fn open_each<T: Send>(
    inputs: &[PathBuf],
    open: &(dyn Fn(&PathBuf) -> Result<T> + Sync),
) -> Result<Vec<T>> {
    if !inputs.iter().any(|input| url_of(input).is_some()) {
        return inputs.iter().map(open).collect();
    }
    let opened: Vec<Mutex<Option<T>>> = inputs.iter().map(|_| Mutex::new(None)).collect();
    run_waiting(inputs.len(), &|number| {
        let input = open(&inputs[number])?;
        *opened[number].lock().unwrap_or_else(PoisonError::into_inner) = Some(input);
        Ok(())
    })?;
    let opened =
        opened.into_iter().filter_map(|input| input.into_inner().unwrap_or_else(PoisonError::into_inner));
    Ok(opened.collect())
}

/// A raster whose pixels are those of a region of another raster.
pub(super) struct MappedRaster<'a> {
    pub(super) raster: &'a mut dyn Raster,
    /// The pixels of the other raster that it covers.
    pub(super) covers: Region,
    pub(super) mapping: PixelMapping,
}

/// Where the pixels of a raster are in the other one.
#[derive(Clone, Copy)]
pub(super) struct PixelMapping {
    /// The pixel of the other raster at which the first pixel begins.
    pub(super) origin: [i64; 2],
    /// Each pixel becomes so many pixels along each axis.
    pub(super) factor: [u64; 2],
}

impl PixelMapping {
    /// Returns the raster's own region for pixels of the other one, which it covers.
    pub(super) fn own_region(&self, pixels: Region) -> Region {
        let along = |axis: usize, start: u64, end: u64| {
            let offset = |at: u64| (at as i64 - self.origin[axis]) as u64;
            (offset(start) / self.factor[axis], offset(end).div_ceil(self.factor[axis]))
        };
        let (left, right) = along(0, pixels.x, pixels.right());
        let (top, bottom) = along(1, pixels.y, pixels.bottom());
        Region::new(left, top, right - left, bottom - top)
    }
}

/// Announces regions of a raster to the remote ones that it consists of, all at the same time.
/// Returns the number of regions that were announced: as many as touch few rasters, since only few
/// stay open.
///
/// # Errors
/// If they cannot be fetched.
pub(super) fn prefetch_mapped(regions: &[Region], rasters: Vec<MappedRaster<'_>>) -> Result<usize> {
    let is_remote = |mapped: &MappedRaster<'_>| url_of(mapped.raster.path()).is_some();
    let mut remote: Vec<(MappedRaster<'_>, Vec<Region>)> =
        rasters.into_iter().filter(is_remote).map(|mapped| (mapped, Vec::new())).collect();
    let (mut taken, mut touched) = (0, 0);
    for region in regions {
        // (A region that touches more is announced alone, and as a whole.)
        let is_touched = |covers: &Region| !covers.intersect(region).is_empty();
        let fresh =
            |(mapped, own): &&(MappedRaster<'_>, Vec<Region>)| own.is_empty() && is_touched(&mapped.covers);
        touched += remote.iter().filter(fresh).count();
        if touched > MAX_AHEAD && taken > 0 {
            break;
        }
        for (mapped, own) in remote.iter_mut().filter(|(mapped, _)| is_touched(&mapped.covers)) {
            own.push(mapped.mapping.own_region(mapped.covers.intersect(region)));
        }
        taken += 1;
    }
    let announced: Vec<_> = remote.into_iter().filter(|(_, own)| !own.is_empty()).map(Mutex::new).collect();
    run_waiting(announced.len(), &|number| {
        let mut announced = announced[number].lock().unwrap_or_else(PoisonError::into_inner);
        let (mapped, own) = &mut *announced;
        mapped.raster.prefetch(own).map(drop)
    })?;
    Ok(taken)
}
