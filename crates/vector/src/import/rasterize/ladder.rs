//! Cache of the parts of nodes that were used last, from which the parts of their descendants are
//! computed.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::space::Code;

use super::shapes::Parts;

/// Cache of parts, with a memory limit in bytes.
pub(super) struct Ladder {
    most: usize,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    nodes: HashMap<Code, (Arc<Parts>, u64)>,
    bytes: usize,
    /// Number of the last query.
    now: u64,
}

impl Ladder {
    /// Creates an empty cache of at most `most` bytes.
    pub(super) fn new(most: usize) -> Ladder {
        Ladder { most, kept: Mutex::default() }
    }

    /// Returns the nearest cached node at or above `code`.
    pub(super) fn nearest(&self, code: Code) -> Option<(Code, Arc<Parts>)> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.now += 1;
        let now = kept.now;
        let mut asked = Some(code);
        while let Some(code) = asked {
            if let Some((parts, last)) = kept.nodes.get_mut(&code) {
                *last = now;
                return Some((code, parts.clone()));
            }
            asked = code.parent();
        }
        None
    }

    /// Inserts the parts of a node. If the limit is exceeded, the least recently used half is
    /// evicted.
    pub(super) fn keep(&self, code: Code, parts: &Arc<Parts>) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let now = kept.now;
        if kept.nodes.insert(code, (parts.clone(), now)).is_none() {
            kept.bytes += parts.bytes();
        }
        if kept.bytes <= self.most {
            return;
        }
        let mut ages: Vec<(u64, usize)> =
            kept.nodes.values().map(|(parts, last)| (*last, parts.bytes())).collect();
        spinney_base::sort::by_key(&mut ages, |(last, _)| *last);
        let mut rest = kept.bytes;
        let mut oldest = 0;
        for (last, bytes) in ages {
            if rest <= self.most / 2 {
                break;
            }
            (oldest, rest) = (last, rest - bytes);
        }
        kept.nodes.retain(|_, (_, last)| *last > oldest);
        kept.bytes = kept.nodes.values().map(|(parts, _)| parts.bytes()).sum();
    }
}
