//! Exact means over pixels of any size, against sums over arrays of cells.

use spinney::export::{Detail, WindowRequest, export_window};
use spinney::raw::export::image::Format;
use spinney::{Bounds, DataKind, Dataset, Dimension, Output, Rule, SampleType, TreeType};

use crate::common::{Cells, OCT, Random, dataset, quad, with};

/// Returns the numbers of an array of pixels; `-1e6` for VOID pixels.
fn exact(tree: &Dataset, bounds: Bounds, (width, height): (u64, u64), memory: u64) -> Vec<f64> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.raw");
    let request = with(WindowRequest::new(bounds, Detail::Exact(width, height)), |it| {
        it.memory = memory;
        it.nodata = Some(if tree.header().rule == Rule::Occupancy { 0.into() } else { (-1_000_000).into() });
    });
    export_window(tree, &request, Output::create(&path).unwrap(), Format::Raw, &()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    match tree.header().form.value.sample {
        SampleType::U8 => bytes.into_iter().map(f64::from).collect(),
        _ => bytes.chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()).into()).collect(),
    }
}

/// Returns the area-weighted means of pixels over a window's cells, by brute force.
fn expected(cells: &Cells, rule: Rule, bounds: Bounds, (width, height): (u64, u64)) -> Vec<f64> {
    let size = bounds.size();
    let channels = usize::from(cells.form.value.channels);
    let mut means = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let (mut sums, mut area) = (vec![0.0; channels], 0.0);
            for y in 0..size[1] {
                for x in 0..size[0] {
                    // The overlap of the cell's interval with the pixel, in pixels.
                    let part = |cell: u64, pixel: u64, pixels: u64, cells: u64| {
                        let scale = pixels as f64 / cells as f64;
                        let low = (cell as f64 * scale).max(pixel as f64);
                        (((cell + 1) as f64 * scale).min((pixel + 1) as f64) - low).max(0.0)
                    };
                    let weight = part(x, column, width, size[0]) * part(y, row, height, size[1]);
                    let value = cells.get([bounds.min[0] + x, bounds.min[1] + y, bounds.min[2]]);
                    if let Some(value) = value {
                        let samples = cells.form.value.samples(value);
                        sums.iter_mut().zip(&samples[..]).for_each(|(sum, sample)| *sum += weight * sample);
                    }
                    if value.is_some() || rule == Rule::Occupancy {
                        area += weight;
                    }
                }
            }
            means.extend(sums.iter().map(|sum| if area > 1e-9 { sum / area } else { -1e6 }));
        }
    }
    means
}

#[test]
fn exact_means_of_pixels() {
    let mut random = Random(77);
    let forms = [
        (quad(SampleType::F32, 1), Rule::Mean),
        (quad(SampleType::F32, 3), Rule::Mean),
        (TreeType::new(Dimension::Oct, quad(SampleType::F32, 1).value), Rule::Mean),
        (OCT, Rule::Occupancy),
    ];
    for round in 0..24 {
        let (form, rule) = forms[round % 4];
        let size = [20 + random.below(60), 20 + random.below(50), if form.axes() == 3 { 9 } else { 1 }];
        let cells = Cells::random(form, random.next(), size, 200, true);
        let min = [random.below(10), random.below(10), size[2] / 2];
        let max = [size[0] - random.below(5), size[1] - random.below(5), min[2] + 1];
        let bounds = Bounds { min, max };
        let pixels = (1 + random.below(40), 1 + random.below(40));
        let expected = expected(&cells, rule, bounds, pixels);
        // Many rows at a time, or one.
        let row = pixels.0 * (4 * 4 + 1 + 8 * 8);
        for memory in [1 << 20, row] {
            let make = || dataset(&cells, rule, DataKind::Continuous);
            let view = make().view(&["translate=0,0".parse().unwrap()]).unwrap();
            for tree in [make(), view] {
                let found = exact(&tree, bounds, pixels, memory);
                assert_eq!(found.len(), expected.len());
                let most = if form.value.sample == SampleType::U8 { 0.500001 } else { 1e-3 };
                for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    assert!((found - expected).abs() < most, "round {round}, pixel {i}: {found}, {expected}");
                }
            }
        }
    }
}

#[test]
fn exact_means_need_continuous_values() {
    let cells = Cells::random(quad(SampleType::U8, 1), 1, [30, 30, 1], 9, true);
    let tree = dataset(&cells, Rule::Majority, DataKind::Categorical);
    let directory = tempfile::tempdir().unwrap();
    let request = WindowRequest::new(tree.header().extent_bounds(), Detail::Exact(7, 7));
    let output = Output::create(&directory.path().join("a.raw")).unwrap();
    let error = export_window(&tree, &request, output, Format::Raw, &()).unwrap_err().to_string();
    assert!(error.contains("not averaged"), "{error}");
}
