//! Where two trees differ.

use crate::space::{Code, Dimension};
use crate::tree::{Child, Source};
use crate::value::Value;
use crate::{Error, Result};

/// A block in which two trees differ, uniform in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference<D: Dimension, V> {
    /// The node.
    pub code: Code<D>,
    /// The first tree's value; `None` is VOID.
    pub before: Option<V>,
    /// The second tree's.
    pub after: Option<V>,
}

/// Hands out all blocks in which two trees differ, in FD order. What two commits of one file have in common is not
/// looked at: time is proportional to what differs, plus depth for each place where something does.
///
/// # Errors
/// If depths differ, a source or `found` fails.
pub fn diff<A, B>(
    first: &A,
    second: &B,
    found: &mut impl FnMut(Difference<A::Dim, A::Value>) -> Result<()>,
) -> Result<()>
where
    A: Source,
    B: Source<Dim = A::Dim, Value = A::Value>,
{
    if first.depth() != second.depth() {
        let expected = format!("{}, as the first tree has", first.depth());
        return Err(Error::invalid("depth of a tree", second.depth().to_string(), expected));
    }
    node(first, second, Code::ROOT, first.root()?, second.root()?, found)
}

fn node<A, B>(
    first: &A,
    second: &B,
    code: Code<A::Dim>,
    a: Child<A::Value, A::Node>,
    b: Child<B::Value, B::Node>,
    found: &mut impl FnMut(Difference<A::Dim, A::Value>) -> Result<()>,
) -> Result<()>
where
    A: Source,
    B: Source<Dim = A::Dim, Value = A::Value>,
{
    let below = |code: Code<A::Dim>, step| code.child(step);
    match (a, b) {
        (Child::Void, Child::Void) => Ok(()),
        (Child::Leaf(a), Child::Leaf(b)) if a.same(b) => Ok(()),
        (Child::Inner { node: a, .. }, Child::Inner { node: b, .. }) => {
            if first.kept(&a).is_some_and(|kept| second.kept(&b) == Some(kept)) {
                return Ok(());
            }
            let pairs = first.children(&a)?.into_iter().zip(second.children(&b)?);
            let mut pairs = pairs.enumerate();
            pairs.try_for_each(|(step, (a, b))| node(first, second, below(code, step), a, b, found))
        }
        (Child::Inner { node: a, .. }, b) => {
            let mut children = first.children(&a)?.into_iter().enumerate();
            children.try_for_each(|(step, a)| node(first, second, below(code, step), a, b.clone(), found))
        }
        (a, Child::Inner { node: b, .. }) => {
            let mut children = second.children(&b)?.into_iter().enumerate();
            children.try_for_each(|(step, b)| node(first, second, below(code, step), a.clone(), b, found))
        }
        (a, b) => found(Difference { code, before: a.value(), after: b.value() }),
    }
}
