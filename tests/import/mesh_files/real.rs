//! Meshes of public projects, compared with the results of another program.

use super::mesh_files::*;
use spinney::raw::import::mesh::open;

#[test]
fn real_meshes_have_the_expected_figures() {
    let Some(folder) = meshes() else { return };
    let table = std::fs::read_to_string(folder.join("expected.tsv")).unwrap();
    let mut count = 0;
    for line in table.lines().skip(1) {
        let columns: Vec<&str> = line.split('\t').collect();
        let number = |column: usize| columns[column].parse::<f64>().unwrap();
        let name = columns[0];
        let mut model = open(&folder.join(name), ENOUGH).unwrap();
        let faces = faces(&mut *model).unwrap();
        let triangles: usize = faces.iter().map(|face| face.points.len() - 2).sum();
        assert_eq!(triangles as f64, number(1), "{name}: triangles");
        let close = |found: f64, expected: f64, scale: f64, what: &str| {
            assert!((found - expected).abs() <= 1e-5 * scale.abs(), "{name}: {what} {found}, not {expected}");
        };
        let [volume, area] = volume_and_area(&faces);
        close(volume, number(7), number(7), "volume");
        close(area, number(8), number(8), "area");
        let [least, greatest] = model.info().bounds;
        for (axis, (least, greatest)) in least.into_iter().zip(greatest).enumerate() {
            close(least, number(9 + axis), greatest - least, "least");
            close(greatest, number(12 + axis), greatest - least, "greatest");
        }
        count += 1;
    }
    assert!(count > 18, "{count} files");
}
