//! Class numbers: a class may have different numbers in different files.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use spinney_base::value::{Number, Palette};
use spinney_base::{Error, Result};
use spinney_container::Metadata;

/// How classes of two files are matched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClassMatching {
    /// By name, if both files have names; else by colour, if both have colours; else by number.
    #[default]
    Name,
    /// By number, regardless of names.
    Number,
}

impl ClassMatching {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        ["name", "number"][self as usize]
    }
}

impl std::fmt::Display for ClassMatching {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for ClassMatching {
    type Err = Error;

    fn from_str(name: &str) -> Result<ClassMatching> {
        match name {
            "name" => Ok(ClassMatching::Name),
            "number" => Ok(ClassMatching::Number),
            _ => Err(Error::invalid("class matching", format!("`{name}`"), "name or number")),
        }
    }
}

/// Classes of a result: names and colours by number, and all numbers in use.
#[derive(Clone, Debug, Default)]
pub(super) struct Classes {
    pub(super) names: BTreeMap<Number, String>,
    pub(super) palette: Option<Palette>,
    numbers: BTreeSet<Number>,
}

/// Class with another number than in its file.
pub(super) struct Renumbered {
    pub(super) from: Number,
    pub(super) to: Number,
}

impl Classes {
    /// Classes of a file, and the numbers that its cells have.
    pub(super) fn of(metadata: &Metadata, present: &[Number]) -> Classes {
        let numbers = metadata.class_names.keys().copied().chain(present.iter().copied()).collect();
        Classes { names: metadata.class_names.clone(), palette: metadata.palette.clone(), numbers }
    }

    /// Whether matching the classes of another file can change a number, so that the numbers of its
    /// cells must be known.
    pub(super) fn may_differ(&self, other: &Metadata) -> bool {
        let names = &other.class_names;
        let has_other_names = !self.names.is_empty() && !names.is_empty() && *names != self.names;
        let palettes = self.palette.as_ref().zip(other.palette.as_ref());
        has_other_names || palettes.is_some_and(|(here, there)| here != there)
    }

    /// Adds the classes of another file, whose cells have the numbers `present`; returns those that
    /// get another number.
    pub(super) fn add(
        &mut self,
        other: &Metadata,
        present: &[Number],
        matching: ClassMatching,
    ) -> Vec<Renumbered> {
        let has_names = !self.names.is_empty() && !other.class_names.is_empty();
        let own = self.clone();
        let mut numbers: BTreeSet<Number> = present.iter().copied().collect();
        numbers.extend(other.class_names.keys().copied());
        let mut renumbered = Vec::new();
        // (Classes that keep their numbers take these first.)
        let mut moved = Vec::new();
        for number in numbers {
            let name = other.class_names.get(&number);
            let to = match matching {
                ClassMatching::Number => Some(number),
                ClassMatching::Name => own.number_of(other, number, name, has_names),
            };
            match to {
                Some(to) => {
                    self.describe(to, name, colour(other.palette.as_ref(), number));
                    if to != number {
                        renumbered.push(Renumbered { from: number, to });
                    }
                }
                None => moved.push((number, name)),
            }
        }
        for (number, name) in moved {
            let to = self.free();
            self.describe(to, name, colour(other.palette.as_ref(), number));
            renumbered.push(Renumbered { from: number, to });
        }
        renumbered
    }

    /// Number of another file's class in this list; `None` if it needs a new one.
    fn number_of(
        &self,
        other: &Metadata,
        number: Number,
        name: Option<&String>,
        has_names: bool,
    ) -> Option<Number> {
        let own_name = self.names.get(&number);
        if has_names {
            return match (name, own_name) {
                (Some(name), Some(own)) if name == own => Some(number),
                (Some(name), _) => {
                    let same = self.names.iter().find(|(_, own)| *own == name).map(|(number, _)| *number);
                    // (A number without a name that cells have is another class.)
                    same.or_else(|| (!self.numbers.contains(&number)).then_some(number))
                }
                (None, Some(_)) => None,
                (None, None) => Some(number),
            };
        }
        let colours = (colour(self.palette.as_ref(), number), colour(other.palette.as_ref(), number));
        match colours {
            (Some(own), Some(theirs)) if own != theirs => {
                let same = |number: &&Number| colour(self.palette.as_ref(), **number) == Some(theirs);
                self.numbers
                    .iter()
                    .find(same)
                    .copied()
                    .or_else(|| (!self.numbers.contains(&number)).then_some(number))
            }
            _ => Some(number),
        }
    }

    /// Smallest positive integer that no class has.
    fn free(&self) -> Number {
        (1u64..).map(Number::Unsigned).find(|number| !self.numbers.contains(number)).unwrap_or_default()
    }

    /// Adds a class; sets its name if it has none, and its colour if it is new.
    fn describe(&mut self, number: Number, name: Option<&String>, colour: Option<[u8; 4]>) {
        let is_new = self.numbers.insert(number);
        if let Some(name) = name {
            self.names.entry(number).or_insert_with(|| name.clone());
        }
        let index =
            number.to_integer().and_then(|index| usize::try_from(index).ok()).filter(|at| *at < 1 << 16);
        if let (Some(palette), Some(index), Some(colour), true) = (&mut self.palette, index, colour, is_new) {
            if palette.colours.len() <= index {
                palette.colours.resize(index + 1, [0; 4]);
            }
            palette.colours[index] = colour;
        }
    }
}

/// Colour of a number; `None` if the palette has no entry, or one that is all zeros.
fn colour(palette: Option<&Palette>, number: Number) -> Option<[u8; 4]> {
    let index = usize::try_from(number.to_integer()?).ok()?;
    palette?.colours.get(index).copied().filter(|colour| *colour != [0; 4])
}
