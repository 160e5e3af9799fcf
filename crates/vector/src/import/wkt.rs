//! Well-known text (ISO 19125), optionally with an SRID prefix (`SRID=4326;POINT (1 2)`).

use super::feature::FeatureGeometry;
use super::heights::Heights;
use super::wkb::{MAX_DEPTH, ParsedGeometry};

type Parsed<T> = Result<T, String>;

/// Parses a geometry.
pub(super) fn parse(text: &str) -> Parsed<ParsedGeometry> {
    let (system, rest) = system_of(text)?;
    let mut reader = Reader { rest: rest.trim(), heights: Heights::default(), is_measured: false };
    let geometry = reader.geometry(0)?;
    if reader.rest.is_empty() {
        Ok(ParsedGeometry { geometry, system, heights: reader.heights })
    } else {
        Err(format!("`{}` after the geometry", reader.shown()))
    }
}

/// Splits text into SRID and geometry.
pub(super) fn system_of(text: &str) -> Parsed<(Option<u32>, &str)> {
    let text = text.trim_start();
    match text.get(..5) {
        Some(word) if word.eq_ignore_ascii_case("SRID=") => {
            let (number, rest) = text[5..].split_once(';').ok_or("SRID= without a semicolon")?;
            let number = number.trim().parse().map_err(|_| format!("SRID={number}"))?;
            Ok((Some(number), rest))
        }
        _ => Ok((None, text)),
    }
}

struct Reader<'t> {
    rest: &'t str,
    heights: Heights,
    /// Whether the third of three coordinates is a measure.
    is_measured: bool,
}

impl<'t> Reader<'t> {
    fn shown(&self) -> String {
        self.rest.chars().take(20).collect()
    }

    /// Consumes a character if it is next; returns whether it was.
    fn has(&mut self, sign: char) -> bool {
        match self.rest.strip_prefix(sign) {
            Some(rest) => {
                self.rest = rest.trim_start();
                true
            }
            None => false,
        }
    }

    fn expect(&mut self, sign: char) -> Parsed<()> {
        if self.has(sign) { Ok(()) } else { Err(format!("`{}` instead of `{sign}`", self.shown())) }
    }

    /// Consumes the next word; empty if there is none.
    fn word(&mut self) -> &'t str {
        let end = self.rest.find(|letter: char| !letter.is_ascii_alphabetic()).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest.trim_start();
        word
    }

    /// Returns whether the geometry is EMPTY; skips Z, M or ZM before that.
    fn is_empty(&mut self) -> Parsed<bool> {
        let mut word = self.word().to_ascii_uppercase();
        if matches!(word.as_str(), "Z" | "M" | "ZM") {
            self.is_measured = word == "M";
            word = self.word().to_ascii_uppercase();
        }
        match word.as_str() {
            "" => Ok(false),
            "EMPTY" => Ok(true),
            other => Err(format!("`{other}` after a geometry type")),
        }
    }

    /// Parses a comma-separated list in parentheses; empty for EMPTY.
    fn list<T>(&mut self, mut member: impl FnMut(&mut Self) -> Parsed<T>) -> Parsed<Vec<T>> {
        if self.is_empty()? {
            return Ok(Vec::new());
        }
        self.expect('(')?;
        let mut members = vec![member(self)?];
        while self.has(',') {
            members.push(member(self)?);
        }
        self.expect(')')?;
        Ok(members)
    }

    /// Parses x, y and further coordinates. The third one is a height unless declared as a measure.
    fn coordinates(&mut self) -> Parsed<([f64; 2], Option<f64>)> {
        let mut point = [0.0; 4];
        let mut axes = 0;
        while axes < 4 {
            let end = self.rest.find([' ', '\t', '\n', '\r', ',', ')', '(']).unwrap_or(self.rest.len());
            let (number, rest) = self.rest.split_at(end);
            if number.is_empty() {
                break;
            }
            let number = number.parse().map_err(|_| format!("`{}` instead of a number", self.shown()))?;
            if let Some(own) = point.get_mut(axes) {
                *own = number;
            }
            self.rest = rest.trim_start();
            axes += 1;
        }
        let has_height = axes > 2 && !self.is_measured;
        self.heights.are_there |= has_height;
        self.heights.have_measures |= axes > 3 || axes > 2 && self.is_measured;
        match point {
            _ if axes < 2 => Err(format!("`{}` instead of two numbers", self.shown())),
            [x, y, height, _] => Ok(([x, y], has_height.then_some(height))),
        }
    }

    fn point(&mut self) -> Parsed<[f64; 2]> {
        let (point, height) = self.coordinates()?;
        self.heights.add_point(height);
        Ok(point)
    }

    fn points(&mut self) -> Parsed<Vec<[f64; 2]>> {
        self.list(Reader::point)
    }

    fn lines(&mut self) -> Parsed<Vec<Vec<[f64; 2]>>> {
        self.list(Reader::points)
    }

    fn geometry(&mut self, depth: usize) -> Parsed<FeatureGeometry> {
        let word = self.word().to_ascii_uppercase();
        // Some writers put no space before Z or M.
        let kind = word.trim_end_matches(['Z', 'M']);
        self.is_measured = &word[kind.len()..] == "M";
        match kind {
            "POINT" => Ok(FeatureGeometry::Points(self.points()?)).and_then(|points| match &points {
                FeatureGeometry::Points(several) if several.len() > 1 => {
                    Err("a POINT with several points".into())
                }
                _ => Ok(points),
            }),
            "LINESTRING" => Ok(FeatureGeometry::Lines(vec![self.points()?])),
            "POLYGON" | "TRIANGLE" => Ok(FeatureGeometry::Polygons(vec![self.lines()?])),
            "MULTIPOINT" => {
                // Parentheses around each point are optional.
                let member = |reader: &mut Self| match reader.rest.starts_with(['(', 'E', 'e']) {
                    true => reader.points(),
                    false => Ok(vec![reader.point()?]),
                };
                Ok(FeatureGeometry::Points(self.list(member)?.into_iter().flatten().collect()))
            }
            "MULTILINESTRING" => Ok(FeatureGeometry::Lines(self.lines()?)),
            "MULTIPOLYGON" => Ok(FeatureGeometry::Polygons(self.list(Reader::lines)?)),
            "GEOMETRYCOLLECTION" if depth == MAX_DEPTH => Err(format!("geometries nested {depth} deep")),
            "GEOMETRYCOLLECTION" => {
                Ok(FeatureGeometry::Collection(self.list(|reader| reader.geometry(depth + 1))?))
            }
            _ => Err(format!("a geometry of type `{}`", word.chars().take(30).collect::<String>())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometries_of_all_kinds() {
        use FeatureGeometry::{Collection, Lines, Points, Polygons};
        let ring = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.5]];
        for (text, expected) in [
            ("POINT (1 2)", Points(vec![[1.0, 2.0]])),
            ("point zm(1 2 3 4)", Points(vec![[1.0, 2.0]])),
            ("POINTZ(1 -2e1 3)", Points(vec![[1.0, -20.0]])),
            ("POINT EMPTY", Points(vec![])),
            ("MULTIPOINT ((1 2), (3 4))", Points(vec![[1.0, 2.0], [3.0, 4.0]])),
            ("MULTIPOINT (1 2,3 4)", Points(vec![[1.0, 2.0], [3.0, 4.0]])),
            ("LINESTRING M (1 2 9, 3 4 9)", Lines(vec![vec![[1.0, 2.0], [3.0, 4.0]]])),
            ("MULTILINESTRING ((1 2,3 4), EMPTY)", Lines(vec![vec![[1.0, 2.0], [3.0, 4.0]], vec![]])),
            ("POLYGON ((0 0,1 0,0 1.5))", Polygons(vec![vec![ring.clone()]])),
            ("MULTIPOLYGON (((0 0,1 0,0 1.5),(0 0,1 0,0 1.5)))", Polygons(vec![vec![ring.clone(); 2]])),
            (
                "GEOMETRYCOLLECTION (POINT (1 2), POLYGON EMPTY)",
                Collection(vec![Points(vec![[1.0, 2.0]]), Polygons(vec![vec![]])]),
            ),
        ] {
            let found = parse(text).unwrap();
            assert_eq!((found.geometry, found.system), (expected, None), "{text}");
            let [z, m] = [[" zm(", "Z("], [" zm(", " M ("]];
            let has = |marks: [&str; 2]| marks.iter().any(|mark| text.contains(mark));
            assert_eq!((found.heights.are_there, found.heights.have_measures), (has(z), has(m)), "{text}");
            assert_eq!(found.heights.of_points, if has(z) { vec![3.0] } else { vec![] }, "{text}");
        }
        assert_eq!(parse("SRID=25832;POINT(1 2)").unwrap().system, Some(25832));
        for wrong in [
            "",
            "POINT",
            "POINT (1)",
            "POINT (1 2",
            "POINT (1 2) x",
            "POINT (1 2,3 4)",
            "CIRCULARSTRING (0 0,1 1,2 0)",
            "POLYGON (0 0,1 1)",
            "SRID=x;POINT (1 2)",
            "é",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        let deep = format!("{}POINT (1 2){}", "GEOMETRYCOLLECTION (".repeat(50), ")".repeat(50));
        assert!(parse(&deep).is_err_and(|error| error.contains("deep")));
    }
}
