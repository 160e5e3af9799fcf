//! Meshes of public projects, against what another program makes of them.

use super::mesh_files::*;
use spinney::import::mesh::open;

#[test]
fn real_meshes_have_the_expected_figures() {
    let Some(folder) = meshes() else { return };
    let table = std::fs::read_to_string(folder.join("expected.tsv")).unwrap();
    let mut count = 0;
    for line in table.lines().filter(|line| line.contains(".ply")) {
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
        let bounds = model.info().bounds;
        for axis in 0..3 {
            let size = bounds[1][axis] - bounds[0][axis];
            close(bounds[0][axis], number(9 + axis), size, "least");
            close(bounds[1][axis], number(12 + axis), size, "greatest");
        }
        count += 1;
    }
    assert!(count > 14, "{count} files");
}
