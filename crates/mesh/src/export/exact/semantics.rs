//! Face values as surface semantics of CityJSON objects.

use std::collections::HashMap;

use super::city_objects::member;
use crate::import::city_semantics::{ATTRIBUTES, PARENT, SURFACE, TYPE};
use spinney_brep::attributes::each_member;

/// Columns of face values that become semantics.
pub(super) const COLUMNS: [&str; 4] = [SURFACE, TYPE, PARENT, ATTRIBUTES];

/// Limit of buffered semantics of a part, in bytes.
const MAX_BYTES: usize = 8 << 20;

/// Semantics of the current part, numbered in the order of first use. Faces with equal values share
/// a number. If a part has more semantics than the buffer holds, or occurs more than once in the
/// sequence of faces, semantics may be duplicated. Parents are then resolved only among semantics
/// that are buffered together.
#[derive(Default)]
pub(super) struct Semantics {
    /// Numbers of the buffered semantics, by their values.
    numbers: HashMap<Vec<Option<String>>, u32>,
    /// Buffered semantics in the order of their numbers.
    held: Vec<Vec<Option<String>>>,
    bytes: usize,
    /// Number of semantics per part, for parts that have any.
    counts: HashMap<u32, u32>,
    lost: u64,
}

impl Semantics {
    /// Number of a part's semantics with these values, one for each column. Returns `None` if the
    /// values have no valid type.
    pub(super) fn number(&mut self, part: u32, values: &[Option<String>]) -> Option<u32> {
        if let Some(number) = self.numbers.get(values) {
            return Some(*number);
        }
        let is_text = |json: &String| serde_json::from_str::<String>(json).is_ok();
        if !values[1].as_ref().is_some_and(is_text) {
            self.lost += u64::from(values.iter().any(Option::is_some));
            return None;
        }
        let count = self.counts.entry(part).or_default();
        let number = *count;
        *count += 1;
        // (Doubled, plus the overhead of the containers.)
        self.bytes += 2 * values.iter().flatten().map(|json| json.len() + 48).sum::<usize>();
        self.numbers.insert(values.to_vec(), number);
        self.held.push(values.to_vec());
        Some(number)
    }

    /// Whether a part has semantics.
    pub(super) fn has_some(&self, part: u32) -> bool {
        self.counts.contains_key(&part)
    }

    /// Whether the buffer exceeds its limit.
    pub(super) fn is_full(&self) -> bool {
        self.bytes > MAX_BYTES
    }

    /// Number of faces, and of semantics members, that were left out.
    pub(super) fn lost(&self) -> u64 {
        self.lost
    }

    /// Removes the buffered semantics and returns them as JSON objects, separated by commas.
    pub(super) fn take(&mut self) -> String {
        let held = std::mem::take(&mut self.held);
        let numbers = std::mem::take(&mut self.numbers);
        self.bytes = 0;
        // Numbers by the surface identifier in the model.
        let of_surface: HashMap<&str, u32> =
            held.iter().filter_map(|values| Some((values[0].as_deref()?, numbers[values]))).collect();
        let mut children: HashMap<u32, Vec<String>> = HashMap::new();
        let parent = |values: &[Option<String>]| of_surface.get(values[2].as_deref()?).copied();
        for values in &held {
            if let Some(parent) = parent(values) {
                children.entry(parent).or_default().push(numbers[values].to_string());
            }
        }
        let surfaces_json = held.iter().map(|values| {
            let mut members = vec![member(TYPE, values[1].as_deref().unwrap_or_default())];
            if let Some(parent) = parent(values) {
                members.push(member(PARENT, &parent.to_string()));
            } else {
                self.lost += u64::from(values[2].is_some());
            }
            if let Some(list) = children.get(&numbers[values]) {
                members.push(member("children", &format!("[{}]", list.join(","))));
            }
            let mut others = Vec::new();
            let known = each_member(values[3].as_deref().unwrap_or("{}"), |key, value| match key {
                "type" | "parent" | "children" => self.lost += 1,
                _ => others.push(member(key, value)),
            });
            match known {
                Ok(()) => members.extend(others),
                Err(_) => self.lost += 1,
            }
            format!("{{{}}}", members.join(","))
        });
        surfaces_json.collect::<Vec<_>>().join(",")
    }
}
