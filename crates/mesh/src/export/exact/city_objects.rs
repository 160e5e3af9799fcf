//! Objects of a CityJSON file without their geometry: attributes of parts, with coordinates adapted
//! to the written file.

use std::collections::{HashMap, HashSet};

use super::Job;
use super::survey::{Survey, join_bounds};
use crate::import::city_semantics::LOD;
use spinney_base::Result;
use spinney_brep::Grid;
use spinney_brep::attributes::{each_member, map_locations};

/// Type of objects without a known type, as JSON.
const PLAIN: &str = "\"GenericCityObject\"";

/// Level of detail of objects without a known one.
const PLAIN_LOD: &str = "2";

/// Exclusive limit of address coordinates, in grid units.
const MAX_COORDINATE: f64 = 9e15;

/// Writes the members of objects in the order of parts.
pub(super) struct CityObjects<'a> {
    job: &'a Job<'a>,
    survey: &'a Survey,
    /// Units of the file per unit of the model.
    factor: f64,
    names: Names,
    /// Part numbers by name. Built when an object with an extent has children.
    numbers: Option<HashMap<&'a str, u32>>,
    /// Vertex number of the next address point.
    next_vertex: u64,
    /// Number of parts whose attributes are not written completely.
    pub(super) lost: u64,
}

impl<'a> CityObjects<'a> {
    /// Objects of a model. Address points get vertex numbers from `next_vertex` on.
    pub(super) fn new(
        job: &'a Job<'a>,
        survey: &'a Survey,
        factor: f64,
        next_vertex: u64,
    ) -> CityObjects<'a> {
        CityObjects { job, survey, factor, names: Names::default(), numbers: None, next_vertex, lost: 0 }
    }

    /// Start of a part's object, as `"name":{"type":...`, and its level of detail.
    pub(super) fn start(&mut self, part: u32) -> Result<(String, String)> {
        let name = self.names.key(self.job.faces.parts().get(part as usize).map_or("", String::as_str));
        let about = self.job.faces.part_attributes(part)?;
        let members = about.as_deref().map(|about| self.members(part, about));
        let is_lost = matches!(members, Some(None | Some(Members { is_whole: false, .. })));
        self.lost += u64::from(is_lost);
        let plain = || Members { text: member("type", PLAIN), lod: PLAIN_LOD.into(), is_whole: true };
        let Members { text, lod, .. } = members.flatten().unwrap_or_else(plain);
        Ok((format!("{name}:{{{text}"), lod))
    }

    /// Members of an object, without its geometry, from the part's attributes `about`. Returns
    /// `None` if `about` is not valid JSON.
    fn members(&mut self, part: u32, about: &str) -> Option<Members> {
        let (mut kind, mut lod, mut is_whole) = (PLAIN.to_string(), PLAIN_LOD.to_string(), true);
        let mut about = about.to_string();
        if has_address(&about) {
            about = map_locations(&about, &mut |points| {
                let Some(points) = self.grid_points(points) else {
                    is_whole = false;
                    return None;
                };
                let first = self.next_vertex;
                self.next_vertex += points.len() as u64;
                let numbers: Vec<String> =
                    (first..self.next_vertex).map(|number| number.to_string()).collect();
                Some(format!("[{}]", numbers.join(",")))
            })
            .ok()?;
        }
        let mut list = Vec::new();
        let (mut extent, mut children) = (None, Vec::new());
        each_member(&about, |key, value| match key {
            "type" => kind = value.into(),
            "geometry" => {}
            LOD => {
                let known =
                    serde_json::from_str(value).ok().filter(|lod: &String| lod.parse::<f64>().is_ok());
                lod = known.unwrap_or_else(|| PLAIN_LOD.into());
            }
            "geographicalExtent" => {
                extent = Some((list.len(), value));
                list.push(String::new());
            }
            _ => {
                if key == "children" {
                    children = serde_json::from_str(value).unwrap_or_default();
                }
                list.push(member(key, value));
            }
        })
        .ok()?;
        if let Some((at, given)) = extent {
            let now = self.extent(part, &children, given);
            list[at] = now.map(|extent| member("geographicalExtent", &extent)).unwrap_or_default();
        }
        let mut text = member("type", &kind);
        for member in list.iter().filter(|member| !member.is_empty()) {
            text.push(',');
            text.push_str(member);
        }
        Some(Members { text, lod, is_whole })
    }

    /// Extent of an object: the bounds of its faces and of its children's faces. Returns `given`
    /// unchanged if it is the same within half a grid unit.
    fn extent(&mut self, part: u32, children: &[String], given: &str) -> Option<String> {
        let mut bounds = self.survey.bounds(part);
        if !children.is_empty() {
            let parts = self.job.faces.parts();
            let numbers =
                self.numbers.get_or_insert_with(|| parts.iter().map(String::as_str).zip(0..).collect());
            for child in children.iter().filter_map(|child| numbers.get(child.as_str())) {
                bounds = join_bounds(bounds, self.survey.bounds(*child));
            }
        }
        let grid = self.job.faces.grid();
        let now = extent_of(bounds?, grid, self.factor);
        let half = grid.width() * self.factor / 2.0;
        let is_same = serde_json::from_str::<[f64; 6]>(given)
            .is_ok_and(|given| given.iter().zip(&now).all(|(given, now)| (given - now).abs() <= half));
        Some(if is_same { given.into() } else { extent_text(now) })
    }

    /// Grid points of an address, from the model's JSON text of its points.
    fn grid_points(&self, points: &str) -> Option<Vec<[i64; 3]>> {
        let points: Vec<[f64; 3]> = serde_json::from_str(points).ok()?;
        let grid = self.job.faces.grid();
        let points: Vec<[f64; 3]> =
            points.into_iter().map(|point| grid.to_grid(point).map(f64::round)).collect();
        let are_near = points.iter().flatten().all(|at| at.abs() < MAX_COORDINATE);
        are_near.then(|| points.into_iter().map(|point| point.map(|at| at as i64)).collect())
    }

    /// Visits the points of all addresses in the order of their vertex numbers.
    pub(super) fn each_address_point(&self, each: &mut dyn FnMut([i64; 3]) -> Result<()>) -> Result<()> {
        for part in 0..self.job.faces.parts().len() as u32 {
            let about = self.job.faces.part_attributes(part)?.filter(|about| has_address(about));
            let mut all = Vec::new();
            if let Some(about) = about {
                // (Invalid JSON is left out as a whole.)
                let _ = map_locations(&about, &mut |points| {
                    all.extend(self.grid_points(points).unwrap_or_default());
                    None
                });
            }
            all.into_iter().try_for_each(&mut *each)?;
        }
        Ok(())
    }
}

fn has_address(about: &str) -> bool {
    about.contains("\"address\"")
}

/// Members of an object.
struct Members {
    text: String,
    lod: String,
    /// Whether all members could be written.
    is_whole: bool,
}

/// Member of a JSON object.
pub(super) fn member(key: &str, json: &str) -> String {
    format!("{}:{json}", serde_json::Value::from(key))
}

/// Object keys made unique.
#[derive(Default)]
struct Names {
    taken: HashSet<String>,
}

impl Names {
    fn key(&mut self, name: &str) -> String {
        let mut unique = name.to_string();
        let mut number = 1;
        while self.taken.contains(&unique) {
            number += 1;
            unique = format!("{name} ({number})");
        }
        let key = serde_json::Value::from(unique.as_str()).to_string();
        self.taken.insert(unique);
        key
    }
}

/// Grid box as an extent in units of the file: minimum coordinates, then maximum coordinates.
pub(super) fn extent_of([low, high]: [[i32; 3]; 2], grid: &Grid, factor: f64) -> [f64; 6] {
    let [low, high] = [low, high].map(|corner| grid.to_world(corner).map(|at| at * factor));
    [low[0], low[1], low[2], high[0], high[1], high[2]]
}

/// Extent as JSON.
pub(super) fn extent_text(extent: [f64; 6]) -> String {
    let numbers = extent.map(|number| serde_json::Value::from(number).to_string());
    format!("[{}]", numbers.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_brep::{Face, FaceList, Grid};

    /// Malformed attributes, and extents that differ from those of the faces.
    #[test]
    fn members_of_objects() {
        let grid = Grid::over([[0.0; 3], [4.0; 3]], Some(0.5)).unwrap();
        let mut faces = FaceList::new(grid, vec!["a".into(), "b".into()]);
        let points = [[0, 0, 0], [8, 0, 0], [0, 8, 2]];
        faces.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part: 1, source: 0 });
        let job = Job { faces: &faces, progress: &(), passes: 0 };
        let survey = Survey::of(&job).unwrap();
        let mut objects = CityObjects::new(&job, &survey, 1.0, 100);
        let mut members = |part: u32, text: &str| {
            objects.members(part, text).map(|Members { text, lod, is_whole }| (text, lod, is_whole))
        };
        let plain = |text: &str| Some((text.to_string(), "2".to_string(), true));
        assert_eq!(members(0, "{}"), plain("\"type\":\"GenericCityObject\""));
        let text = "{\"a\":[1.10],\"geometry\":[7],\"type\":\"Road\",\"type\":\"Bridge\"}";
        assert_eq!(members(0, text), plain("\"type\":\"Road\",\"a\":[1.10]"));
        for wrong in ["", "{", "[]", "{\"a\":}", "{}}", "{\"a\":1},\"b\":{}", "{\"address\":[}"] {
            assert_eq!(members(0, wrong), None, "{wrong}");
        }
        let mut lod = |lod: &str| members(0, &format!("{{\"type\":\"Road\",\"lod\":{lod}}}")).unwrap().1;
        assert_eq!(["\"2.2\"", "\"x\"", "[]"].map(&mut lod), ["2.2", "2", "2"]);
        // Extents of own faces, of children's faces, and without any faces.
        let mut extent = |part: u32, more: &str, extent: &str| {
            let text = format!("{{\"type\":\"Road\"{more},\"geographicalExtent\":{extent},\"z\":1}}");
            members(part, &text).unwrap().0.replace("\"geographicalExtent\":", "")
        };
        let children = ",\"children\":[\"b\",\"c\"]";
        assert_eq!(extent(1, "", "[0,0,0,4,4,1]"), "\"type\":\"Road\",[0,0,0,4,4,1],\"z\":1");
        assert_eq!(extent(1, "", "[7,0,0,9,4,1]"), "\"type\":\"Road\",[0.0,0.0,0.0,4.0,4.0,1.0],\"z\":1");
        assert!(extent(0, children, "[]").contains(",[0.0,0.0,0.0,4.0,4.0,1.0],"));
        assert_eq!(extent(0, "", "[0,0,0,4,4,1]"), "\"type\":\"Road\",\"z\":1");
        // Address points become vertices; vertex numbers of another file are lost.
        let address = |points: &str| {
            format!("{{\"type\":\"Road\",\"address\":[{{\"location\":{{\"boundaries\":{points}}}}},{{}}]}}")
        };
        let found = members(0, &address("[[1,2,0.5],[9,9,-1]]")).unwrap();
        assert!(found.2 && found.0.contains("\"boundaries\":[100,101]"), "{}", found.0);
        assert!(members(0, &address("[[0,0,0]]")).unwrap().0.contains("\"boundaries\":[102]"));
        assert_eq!(
            members(0, &address("[7]")),
            Some(("\"type\":\"Road\",\"address\":[{},{}]".into(), "2".into(), false))
        );
    }
}
