//! Cache of the parts of nodes that were used last, from which the parts of their descendants are
//! computed.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::space::Code;

use super::shapes::ClippedShapes;

/// Cache of parts, with a memory limit in bytes.
pub(super) struct NodeCache {
    max_bytes: usize,
    cached: Mutex<CachedNodes>,
}

#[derive(Default)]
struct CachedNodes {
    nodes: HashMap<Code, (Arc<ClippedShapes>, u64)>,
    bytes: usize,
    /// Number of the last query.
    now: u64,
}

impl NodeCache {
    /// Creates an empty cache of at most `max_bytes` bytes.
    pub(super) fn new(max_bytes: usize) -> NodeCache {
        NodeCache { max_bytes, cached: Mutex::default() }
    }

    /// Returns the nearest cached node at or above `code`.
    pub(super) fn nearest(&self, code: Code) -> Option<(Code, Arc<ClippedShapes>)> {
        let mut cached = self.cached.lock().unwrap_or_else(PoisonError::into_inner);
        cached.now += 1;
        let now = cached.now;
        let mut next = Some(code);
        while let Some(code) = next {
            if let Some((parts, last)) = cached.nodes.get_mut(&code) {
                *last = now;
                return Some((code, parts.clone()));
            }
            next = code.parent();
        }
        None
    }

    /// Inserts the parts of a node. If the limit is exceeded, the least recently used half is
    /// evicted.
    pub(super) fn insert(&self, code: Code, parts: &Arc<ClippedShapes>) {
        let mut cached = self.cached.lock().unwrap_or_else(PoisonError::into_inner);
        let now = cached.now;
        if cached.nodes.insert(code, (parts.clone(), now)).is_none() {
            cached.bytes += parts.bytes();
        }
        if cached.bytes <= self.max_bytes {
            return;
        }
        let mut ages: Vec<(u64, usize)> =
            cached.nodes.values().map(|(parts, last)| (*last, parts.bytes())).collect();
        spinney_base::sort::by_key(&mut ages, |(last, _)| *last);
        let mut rest = cached.bytes;
        let mut oldest = 0;
        for (last, bytes) in ages {
            if rest <= self.max_bytes / 2 {
                break;
            }
            (oldest, rest) = (last, rest - bytes);
        }
        cached.nodes.retain(|_, (_, last)| *last > oldest);
        cached.bytes = cached.nodes.values().map(|(parts, _)| parts.bytes()).sum();
    }
}
