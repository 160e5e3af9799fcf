//! Variants of text formats that programs write.

use spinney_base::Result;

/// Corners and colours of a file's faces, the number of its parts, and remarks.
type Found = (Vec<Vec<[f64; 3]>>, Vec<Vec<[u8; 3]>>, usize, Vec<String>);

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Found> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let mut model = super::open(&path, 1 << 20)?;
    let (mut faces, mut colours) = (Vec::new(), Vec::new());
    model.faces(&mut |face| {
        faces.push(face.points.to_vec());
        colours.push(face.colours.to_vec());
        Ok(())
    })?;
    Ok((faces, colours, model.info().parts.len(), model.remarks()))
}

const OFF: &str = "OFF\n4 4 6\n0 0 0\n2 0 0\n0 2 0\n0 0 2\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

#[test]
fn off_with_other_line_breaks_and_case() {
    let expected = read("a.off", OFF).unwrap().0;
    assert_eq!((expected.len(), expected[3][2]), (4, [0.0, 0.0, 2.0]));
    let numbers = OFF.strip_prefix("OFF\n4 4 6\n").unwrap();
    let words = numbers.split_whitespace().collect::<Vec<_>>();
    for text in [
        OFF.to_lowercase(),
        format!("OFF\n4\n4\n6\n{numbers}"),
        format!("OFF\n4\n4\n{numbers}"),
        format!("OFF\n# counts\n4 4\n{numbers}"),
        format!("OFF 4 4 6 {}", words.join(" ")),
        format!("OFF4 4 6\n{}\n", words.join(" ")),
        format!("OFF\n4\n4\n6\n{}\n", words.join("\n")),
        OFF.replace("3 0 2 1", "3\n0 2\n1 # a face"),
        OFF.replace('\n', "\r"),
    ] {
        assert_eq!(read("a.off", &text).unwrap().0, expected, "{text}");
    }
    for (from, to, words) in [
        ("0 0 2\n", "0 0\n", "vertex 3, line 6"),
        ("3 0 2 1", "4 0 2 1", "face 0, line 7"),
        ("3 0 2 1", "3 0 2 4", "face 0, line 7"),
        ("4 4 6", "4 5 6", "face 4"),
        ("4 4 6", "4 x 6", "line 2"),
    ] {
        let error = read("a.off", OFF.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(words), "{from} -> {to}: {error}");
    }
}

#[test]
fn colours_of_off_have_one_range_in_a_file() {
    let colours = |text: &str| read("a.off", text).unwrap().1;
    let vertices = |a: &str, b: &str| format!("COFF\n3 1 0\n0 0 0 {a}\n1 0 0 {b}\n0 1 0 1 0 0 1\n3 0 1 2\n");
    assert_eq!(colours(&vertices("0.5 0.5 0.5 1", "1 1 1 1"))[0], [[128; 3], [255; 3], [255, 0, 0]]);
    assert_eq!(colours(&vertices("255 0 51", "1 1 1"))[0], [[255, 0, 51], [1; 3], [1, 0, 0]]);
    let faces = OFF.replace("3 0 2 1", "3 0 2 1 1 0 0").replace("3 1 2 3", "3 1 2 3 0.2 0 1");
    let found = colours(&faces);
    assert_eq!(
        (&found[0][..1], &found[1][..1], &found[3][..1]),
        (&[[255, 0, 0]][..], &[[255; 3]][..], &[[51, 0, 255]][..])
    );
}

const FACET: &str =
    "facet normal 0 0 nan\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

#[test]
fn stl_text_of_other_programs() {
    let text = format!("solid a cube\n{FACET}{FACET}endsolid a cube\n");
    let expected = read("a.stl", &text).unwrap().0;
    assert_eq!(expected, vec![vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]; 2]);
    for text in [
        text.replace("endsolid", "end solid"),
        text.replace("endloop", "end loop").replace("endfacet", "END FACET"),
        text.replace("a cube", ""),
        text.replace("a cube", "name ".repeat(2000).trim_end()),
        text.replace("a cube\nfacet", "a cube\n# facets\ncolor 1 0 0\nfacet"),
        format!("# made by hand\n{text}"),
        text.replace("facet normal", "\n\t; remark\n// another\nfacet normal"),
        text.replace('\n', " "),
        text.replace('\n', "\r"),
        text.to_uppercase(),
    ] {
        assert_eq!(read("a.stl", &text).unwrap().0, expected, "{}", &text[..120]);
    }
    let one_line = (text.clone() + &text.replace("a cube", "rock")).replace('\n', " ");
    let (faces, _, parts, _) = read("a.stl", one_line).unwrap();
    assert_eq!((faces.len(), parts), (4, 2));
    for (from, to, words) in [
        ("vertex 1", "vertex inf", "line 5"),
        ("vertex 1", "vertex", "line 5"),
        ("vertex 1", "", "line 5"),
        ("endfacet", "", "line 9"),
        ("outer loop", "vertex 0 0 0", "line 6"),
        ("endsolid a cube\n", "", "the end of the file"),
    ] {
        let error = read("a.stl", text.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(words), "{from} -> {to}: {error}");
    }
}

#[test]
fn bytes_after_the_facets_of_a_binary_stl() {
    let file = |count: u32, declared: u32| {
        let mut bytes = vec![b' '; 80];
        bytes.extend(declared.to_le_bytes());
        for facet in 0..count {
            bytes.extend([0; 12]);
            let z = facet as f32;
            let corners = [0.0, 0.0, z, 1.0, 0.0, z, 0.0, 1.0, z];
            corners.iter().for_each(|number: &f32| bytes.extend(number.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    };
    let (faces, _, parts, remarks) = read("a.stl", file(3, 3)).unwrap();
    assert_eq!((faces.len(), parts, remarks.len()), (3, 1, 0));
    // Concatenated files become separate solids.
    let (faces, _, parts, remarks) = read("a.stl", [file(3, 3), file(2, 2)].concat()).unwrap();
    assert_eq!((faces.len(), parts, remarks.len()), (5, 2, 0));
    // Facets beyond the declared number are reported.
    let (faces, _, _, remarks) = read("a.stl", file(5, 3)).unwrap();
    assert_eq!(faces.len(), 3);
    assert!(remarks[0].contains("3 facets") && remarks[0].contains("2 facets"), "{remarks:?}");
    assert!(read("a.stl", file(3, 4)).unwrap_err().to_string().contains("for 4 facets"));
}
