//! Meshes of public projects, compared with the results of another program.

use super::mesh_files::*;
use spinney::raw::import::mesh::open;

#[test]
fn real_meshes_have_the_expected_figures() {
    let Some(directory) = meshes() else { return };
    let table = std::fs::read_to_string(directory.join("expected.tsv")).unwrap();
    let mut count = 0;
    for line in table.lines().skip(1) {
        let columns: Vec<&str> = line.split('\t').collect();
        let number = |column: usize| columns[column].parse::<f64>().unwrap();
        let name = columns[0];
        let mut model = open(&directory.join(name), ENOUGH).unwrap();
        let faces = faces(&mut *model).unwrap();
        let triangles: usize = faces.iter().map(|face| face.points.len() - 2).sum();
        assert_eq!(triangles as f64, number(1), "{name}: triangles");
        let close = |found: f64, expected: f64, scale: f64, what: &str| {
            assert!((found - expected).abs() <= 1e-5 * scale.abs(), "{name}: {what} {found}, not {expected}");
        };
        let [volume, area] = volume_and_area(&faces);
        close(volume, number(7), number(7), "volume");
        close(area, number(8), number(8), "area");
        let [min, max] = model.info().bounds;
        for (axis, (min, max)) in min.into_iter().zip(max).enumerate() {
            close(min, number(9 + axis), max - min, "min");
            close(max, number(12 + axis), max - min, "max");
        }
        count += 1;
    }
    assert!(count > 18, "{count} files");
}
