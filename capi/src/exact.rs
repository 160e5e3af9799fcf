//! Queries with results in the dataset's own sample type. These are exact for 64-bit integers, too,
//! for which doubles are not.

use std::ffi::c_void;

use engine::query::PointSamples;
use engine::{Number, Value, ValueType};

use crate::dataset::{level_of, opened, spinney_dataset};
use crate::queries::{bounds_at, buffer, flags, sizes, some_bounds_at, spinney_box};
use crate::status::{Failure, guarded, spinney_status};

/// Like spinney_read(), but cells that are VOID or outside get the sample that `fill` points to, in
/// every channel. The fill sample has the dataset's sample type.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_read_filled(
    dataset: *const spinney_dataset,
    level: u32,
    cells: *const spinney_box,
    fill: *const c_void,
    samples: *mut c_void,
    samples_size: usize,
    valid: *mut u8,
    valid_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `some_bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, some_bounds_at(cells)?) };
        let value = dataset.header().form.value;
        if fill.is_null() {
            return Err(Failure::invalid("fill: got NULL, expected a sample"));
        }
        // SAFETY: the caller has a sample there.
        let fill = unsafe { std::slice::from_raw_parts(fill.cast::<u8>(), value.sample.size()) };
        let fill = ValueType::new(value.sample, 1).first_number(Value::from_bytes(fill));
        let (count, bytes) = sizes(&bounds, dataset.header().form.width())?;
        // SAFETY: see `buffer`.
        let samples = unsafe { buffer("samples", samples.cast(), samples_size, Some(bytes))? };
        let valid = if valid.is_null() && valid_size == 0 {
            None
        } else {
            // SAFETY: see `buffer`.
            Some(flags(unsafe { buffer("valid", valid, valid_size, Some(count))? }))
        };
        Ok(dataset.window(level_of(level), &bounds, fill, samples, valid)?)
    })
}

/// Like spinney_points(), but `samples` gets the unconverted samples of each cell, `cell_size`
/// bytes per cell (`samples_size` bytes in total). Samples of cells that are VOID or outside are 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_point_samples(
    dataset: *const spinney_dataset,
    level: u32,
    cells: *const [u64; 3],
    count: usize,
    samples: *mut c_void,
    samples_size: usize,
    valid: *mut u8,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = &unsafe { opened(dataset) }?.dataset;
        let width = dataset.header().form.width();
        let bytes = count.checked_mul(width).filter(|_| !cells.is_null() || count == 0);
        let bytes =
            bytes.ok_or_else(|| Failure::invalid("cells: got NULL or too many, expected x, y, z of each"))?;
        // SAFETY: the caller has `count` cells and flags there, and `samples_size` bytes for
        // samples.
        let (cells, samples, valid) = unsafe {
            let cells = if count == 0 { &[][..] } else { std::slice::from_raw_parts(cells, count) };
            let valid = if valid.is_null() { &mut [][..] } else { buffer("valid", valid, count, None)? };
            (cells, buffer("samples", samples.cast::<u8>(), samples_size, Some(bytes as u64))?, valid)
        };
        let mut found = PointSamples::default();
        dataset.points(cells, level_of(level), &mut found)?;
        for (index, samples) in samples.chunks_exact_mut(width).enumerate() {
            let value = found.value(index);
            value.unwrap_or_default().write(samples);
            if let Some(valid) = valid.get_mut(index) {
                *valid = value.is_some().into();
            }
        }
        Ok(())
    })
}

/// Writes the minimum and maximum sample of each channel to `min` and `max`, over a box of
/// cells of the deepest level, or over all cells if `cells` is NULL. Both buffers have `cell_size`
/// bytes (`size`). Channels without samples get 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_extremes(
    dataset: *const spinney_dataset,
    cells: *const spinney_box,
    min: *mut c_void,
    max: *mut c_void,
    size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, bounds_at(cells)?) };
        let value = dataset.header().form.value;
        let width = Some(value.size() as u64);
        // SAFETY: see `buffer`.
        let (min, max) = unsafe {
            let min = buffer("min", min.cast::<u8>(), size, width)?;
            (min, buffer("max", max.cast::<u8>(), size, width)?)
        };
        let found = dataset.statistics(bounds, &())?;
        let channel = |channel: usize| found.channels.get(channel).filter(|channel| channel.cells > 0);
        let sample = |index: usize, of: fn(&engine::query::ChannelStatistics) -> Number| {
            channel(index).map_or(Number::default(), of)
        };
        value.nearest_numbers(|index| sample(index, |channel| channel.min)).write(min);
        value.nearest_numbers(|index| sample(index, |channel| channel.max)).write(max);
        Ok(())
    })
}

/// Like spinney_classes(), but `values` gets samples of the dataset's type. It has a capacity of
/// `capacity` samples.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_class_samples(
    dataset: *const spinney_dataset,
    cells: *const spinney_box,
    values: *mut c_void,
    counts: *mut u64,
    capacity: usize,
    count: *mut usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, bounds_at(cells)?) };
        let value = ValueType::new(dataset.header().form.value.sample, 1);
        let bytes = capacity.checked_mul(value.size());
        let bytes = bytes.ok_or_else(|| {
            Failure::invalid(format!("capacity: got {capacity}, which exceeds the address space"))
        })?;
        // SAFETY: these point to the caller's memory, or are NULL, which is detected.
        let (values, counts, count) = unsafe {
            let count =
                count.as_mut().ok_or_else(|| Failure::invalid("count: got NULL, expected a pointer"))?;
            let values = buffer("values", values.cast::<u8>(), bytes, None)?;
            (values, buffer("counts", counts, capacity, None)?, count)
        };
        let found = dataset.statistics(bounds, &())?;
        let outputs = values.chunks_exact_mut(value.size()).zip(counts);
        for ((output, cells), (class, found)) in outputs.zip(&found.classes) {
            value.nearest_numbers(|_| *class).write(output);
            *cells = *found;
        }
        *count = found.classes.len();
        Ok(())
    })
}

/// Writes the input's nodata number as a sample of the dataset's type, of `size` bytes.
/// SPINNEY_UNSUPPORTED if there is none, or if the sample type cannot hold it: `nodata` of
/// spinney_info has the nearest double.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_nodata(
    dataset: *const spinney_dataset,
    sample: *mut c_void,
    size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = &unsafe { opened(dataset) }?.dataset;
        let value = ValueType::new(dataset.header().form.value.sample, 1);
        // SAFETY: see `buffer`.
        let sample = unsafe { buffer("sample", sample.cast::<u8>(), size, Some(value.size() as u64))? };
        let nodata = dataset.metadata().nodata;
        let held = nodata.filter(|number| value.sample.is_float() || value.sample.can_hold(*number));
        let held =
            held.ok_or_else(|| Failure::unsupported("nodata: there is none that the sample type can hold"))?;
        value.nearest_numbers(|_| held).write(sample);
        Ok(())
    })
}
