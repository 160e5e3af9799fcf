//! A solid as its text tells it: primitives, moved and combined, parts of which may be there many times.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use crate::affine::Affine;
use crate::lowered::Lowered;
use crate::shape::Shape;
use crate::syntax::{At, parse, wrong};
use spinney_base::{Error, Result};

/// Most primitives, operations and maps of a solid, those of a name counted as often as it is there.
const MAX_NODES: u32 = 1 << 20;

/// A part of a solid while its text is read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solid(u32);

/// A node of a solid. What it is of comes before it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Node {
    /// A primitive by its number, and the map from its own coordinates.
    Primitive(u32),
    /// An operation on nodes, by where they stand among the links.
    Any(u32, u32),
    /// As above.
    All(u32, u32),
    /// As above.
    Odd(u32, u32),
    /// The complement of a node.
    Not(u32),
    /// A node moved by a map with a number.
    Moved(u32, u32),
}

/// A primitive of a text.
#[derive(Clone, Debug)]
pub(crate) struct Primitive {
    pub(crate) shape: Shape,
    /// The map from its own coordinates to those of the text.
    pub(crate) map: Affine,
    /// The word that makes it.
    pub(crate) word: String,
    pub(crate) at: At,
}

/// Builds a solid from its parts.
pub(crate) struct Builder<'a> {
    path: &'a Path,
    nodes: Vec<Node>,
    links: Vec<u32>,
    maps: Vec<Affine>,
    primitives: Vec<Primitive>,
    /// Nodes that each one is made of, counted as often as they are there.
    sizes: Vec<u32>,
}

impl<'a> Builder<'a> {
    pub(crate) fn new(path: &'a Path) -> Builder<'a> {
        let (nodes, links, maps, primitives, sizes) = Default::default();
        Builder { path, nodes, links, maps, primitives, sizes }
    }

    /// Adds a node that is made of others.
    fn push(&mut self, node: Node, of: &[Solid], at: At) -> Result<Solid> {
        let size = of.iter().fold(1, |sum: u32, solid| sum.saturating_add(self.sizes[solid.0 as usize]));
        if size > MAX_NODES {
            let found = format!(
                "a solid of more than {MAX_NODES} primitives, operations and maps, those of names counted as often as they are used"
            );
            return Err(wrong(self.path, at, found, "fewer: divide it into several files"));
        }
        self.nodes.push(node);
        self.sizes.push(size);
        Ok(Solid(self.nodes.len() as u32 - 1))
    }

    /// A primitive.
    pub(crate) fn primitive(&mut self, shape: Shape, map: Affine, word: &str, at: At) -> Result<Solid> {
        self.primitives.push(Primitive { shape, map, word: word.into(), at });
        self.push(Node::Primitive(self.primitives.len() as u32 - 1), &[], at)
    }

    fn operation(&mut self, solids: &[Solid], at: At, node: fn(u32, u32) -> Node) -> Result<Solid> {
        if let [solid] = solids {
            return Ok(*solid);
        }
        let first = self.links.len() as u32;
        self.links.extend(solids.iter().map(|solid| solid.0));
        self.push(node(first, self.links.len() as u32), solids, at)
    }

    /// Union: points in any of some.
    pub(crate) fn union(&mut self, solids: &[Solid], at: At) -> Result<Solid> {
        self.operation(solids, at, Node::Any)
    }

    /// Intersection: points in all of some.
    pub(crate) fn intersection(&mut self, solids: &[Solid], at: At) -> Result<Solid> {
        self.operation(solids, at, Node::All)
    }

    /// Symmetric difference: points in an odd number of some.
    pub(crate) fn xor(&mut self, solids: &[Solid], at: At) -> Result<Solid> {
        self.operation(solids, at, Node::Odd)
    }

    /// Complement: points not in one.
    pub(crate) fn complement(&mut self, solid: Solid, at: At) -> Result<Solid> {
        self.push(Node::Not(solid.0), &[solid], at)
    }

    /// One moved by a map.
    pub(crate) fn moved(&mut self, map: Affine, solid: Solid, at: At) -> Result<Solid> {
        self.maps.push(map);
        self.push(Node::Moved(self.maps.len() as u32 - 1, solid.0), &[solid], at)
    }

    /// The solid that a node is, of a text.
    pub(crate) fn finish(
        self,
        text: &str,
        root: Solid,
        bounds: Option<[[f64; 3]; 2]>,
        unit: Option<String>,
    ) -> Result<Csg> {
        let Builder { path, nodes, links, maps, primitives, .. } = self;
        let tree = Tree { nodes, links, maps, primitives, root: root.0 };
        let lowered = Lowered::of(path, &tree)?;
        Ok(Csg {
            path: path.to_path_buf(),
            text: text.into(),
            primitives: tree.primitives,
            lowered,
            bounds,
            unit,
        })
    }
}

/// The nodes of a solid.
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node>,
    pub(crate) links: Vec<u32>,
    pub(crate) maps: Vec<Affine>,
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) root: u32,
}

/// A solid of primitives that were moved and combined, such as a text tells it: `docs/csg.md` is the language.
///
/// ```
/// use spinney::raw::csg::Csg;
///
/// let text = "difference(block(0,0,0, 2,2,2), ball(1,1,2, 0.5))";
/// assert_eq!(Csg::parse("dented".as_ref(), text)?.primitives(), 2);
/// let error = Csg::parse("dented".as_ref(), "ball(0,0,0, -1)").unwrap_err();
/// assert!(error.to_string().starts_with("dented, line 1, column 1: got the radius -1, expected a length above zero"));
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Csg {
    pub(crate) path: PathBuf,
    text: String,
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) lowered: Lowered,
    pub(crate) bounds: Option<[[f64; 3]; 2]>,
    unit: Option<String>,
}

impl Csg {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is no text in UTF-8, or no solid.
    pub fn open(path: &Path) -> Result<Csg> {
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        // (One more than a text may have tells that it is too long.)
        file.take((8 << 20) + 1).read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let place = format!("byte {}", error.utf8_error().valid_up_to());
            Error::corrupt(path, place, "bytes that are no UTF-8", "a text that tells a solid")
        })?;
        Csg::parse(path, &text)
    }

    /// Reads a text; messages name its path.
    ///
    /// # Errors
    /// If it is no solid; the error tells line and column, what stands there and what is expected.
    pub fn parse(path: &Path, text: &str) -> Result<Csg> {
        parse(path, text)
    }

    /// The text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The unit of length that the text tells.
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Number of its primitives, each counted as often as it is there.
    pub fn primitives(&self) -> usize {
        self.lowered.instances.len()
    }

    /// The number of its primitives in words.
    pub(crate) fn counted(&self) -> String {
        match self.primitives() {
            1 => "1 primitive".into(),
            count => format!("{count} primitives"),
        }
    }

    /// Whether a file's name is that of such a text.
    pub fn is_name(path: &Path) -> bool {
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csg"))
    }
}
