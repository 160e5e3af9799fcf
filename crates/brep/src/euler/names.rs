//! Names of entities in the text format of operators: a letter and a number, such as `v4`.

use std::collections::HashMap;

/// A kind of entity that has names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Vertex,
    Edge,
    Face,
    Ring,
}

impl Kind {
    pub(super) fn letter(self) -> char {
        ['v', 'e', 'f', 'r'][self as usize]
    }

    /// Returns a description of a name, with its article.
    pub(super) fn expected(self) -> &'static str {
        ["a vertex, such as v4", "an edge, such as e4", "a face, such as f4", "a ring, such as r4"]
            [self as usize]
    }
}

/// State of a name.
#[derive(Clone, Copy, Debug)]
struct Named {
    /// Number of the entity in the body.
    entity: u32,
    /// Line of the operator that killed the entity, or 0.
    killed: u32,
}

/// Why a name has no entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unnamed {
    /// It was never given.
    Unknown,
    /// The entity was killed in this line.
    Killed(u32),
}

/// Entities by their names. A name is given once.
#[derive(Clone, Debug, Default)]
pub(super) struct Names {
    kinds: [HashMap<u32, Named>; 4],
}

impl Names {
    /// Bytes of memory per name.
    pub(super) const BYTES: u64 = 32;

    /// Parses a name of a kind.
    pub(super) fn parse(kind: Kind, word: &str) -> Option<u32> {
        let digits = word.strip_prefix(kind.letter())?;
        let is_plain = digits == "0" || !digits.starts_with('0');
        let is_number = is_plain && digits.bytes().all(|byte| byte.is_ascii_digit());
        is_number.then(|| digits.parse().ok()).flatten()
    }

    pub(super) fn get(&self, kind: Kind, name: u32) -> Result<u32, Unnamed> {
        match self.kinds[kind as usize].get(&name) {
            None => Err(Unnamed::Unknown),
            Some(Named { killed: 0, entity }) => Ok(*entity),
            Some(Named { killed, .. }) => Err(Unnamed::Killed(*killed)),
        }
    }

    /// Gives a name, which must not have been given before.
    pub(super) fn add(&mut self, kind: Kind, name: u32, entity: u32) {
        self.kinds[kind as usize].insert(name, Named { entity, killed: 0 });
    }

    pub(super) fn is_new(&self, kind: Kind, name: u32) -> bool {
        !self.kinds[kind as usize].contains_key(&name)
    }

    pub(super) fn kill(&mut self, kind: Kind, name: u32, line: u32) {
        if let Some(named) = self.kinds[kind as usize].get_mut(&name) {
            named.killed = line.max(1);
        }
    }

    /// Returns the name of an entity. Searches all names: use it for messages only.
    pub(super) fn name_of(&self, kind: Kind, entity: u32) -> String {
        let is_it = |named: &&Named| named.killed == 0 && named.entity == entity;
        let found = self.kinds[kind as usize].iter().filter(|(_, named)| is_it(named)).map(|(name, _)| *name);
        found.min().map_or_else(|| "?".into(), |name| format!("{}{name}", kind.letter()))
    }

    pub(super) fn bytes(&self) -> u64 {
        self.kinds.iter().map(|names| names.capacity() as u64).sum::<u64>() * Names::BYTES
    }
}
