//! A CSG solid as a graph of nodes: primitives, transforms and operations. Named subgraphs may be
//! used several times.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use crate::affine::Affine;
use crate::lowered::Lowered;
use crate::patches::{csg_of_patches, is_patch_file};
use crate::shape::Shape;
use crate::syntax::{At, parse, solid_of_patches, wrong};
use spinney_base::{Error, Result};

/// Maximum number of primitives, operations and transforms of a solid. Named subgraphs count each
/// time they are used.
const MAX_NODES: u32 = 1 << 20;

/// Maximum length of a text, in bytes.
const MAX_BYTES: u64 = 8 << 20;

/// Checks the length of a text.
pub(crate) fn check_length(path: &Path, text: &str) -> Result<()> {
    if text.len() as u64 <= MAX_BYTES {
        return Ok(());
    }
    let found = format!("a CSG text of {} bytes, above {MAX_BYTES},", text.len());
    let advice = "divide it into several files, build each, and combine the results";
    Err(Error::unsupported(path, found, advice))
}

/// Handle of a node while the text is parsed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solid(u32);

/// A node of a solid. Its operands precede it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Node {
    /// A primitive by its number.
    Primitive(u32),
    /// Union of the nodes in a range of `links`.
    Any(u32, u32),
    /// Intersection of the nodes in a range of `links`.
    All(u32, u32),
    /// Symmetric difference of the nodes in a range of `links`.
    Odd(u32, u32),
    /// The complement of a node.
    Not(u32),
    /// A transform by its number, and the node that it is applied to.
    Moved(u32, u32),
}

/// A primitive of a CSG text.
#[derive(Clone, Debug)]
pub(crate) struct Primitive {
    pub(crate) shape: Shape,
    /// Transform from local coordinates to those of the text.
    pub(crate) map: Affine,
    /// The keyword that defines it.
    pub(crate) word: String,
    pub(crate) at: At,
}

impl Primitive {
    /// Returns the name of the primitive in messages, and of its part of a model.
    pub(crate) fn name(&self) -> String {
        match self.word == "bounds" {
            true => self.word.clone(),
            false => format!("{} in line {}", self.word, self.at.line),
        }
    }
}

/// Builds the graph of a solid.
pub(crate) struct Builder<'a> {
    path: &'a Path,
    nodes: Vec<Node>,
    links: Vec<u32>,
    maps: Vec<Affine>,
    primitives: Vec<Primitive>,
    /// Size of each node's subgraph, counting shared nodes each time they are used.
    sizes: Vec<u32>,
}

impl<'a> Builder<'a> {
    pub(crate) fn new(path: &'a Path) -> Builder<'a> {
        let (nodes, links, maps, primitives, sizes) = Default::default();
        Builder { path, nodes, links, maps, primitives, sizes }
    }

    /// Adds a node with its operands.
    fn push(&mut self, node: Node, of: &[Solid], at: At) -> Result<Solid> {
        let size = of.iter().fold(1, |sum: u32, solid| sum.saturating_add(self.sizes[solid.0 as usize]));
        if size > MAX_NODES {
            let found = format!(
                "a solid of more than {MAX_NODES} primitives, operations and transforms, counting each use of a name"
            );
            return Err(wrong(self.path, at, found, "fewer: divide it into several files"));
        }
        self.nodes.push(node);
        self.sizes.push(size);
        Ok(Solid(self.nodes.len() as u32 - 1))
    }

    /// Adds a primitive.
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

    /// Adds a union: points in any operand.
    pub(crate) fn union(&mut self, solids: &[Solid], at: At) -> Result<Solid> {
        self.operation(solids, at, Node::Any)
    }

    /// Adds an intersection: points in all operands.
    pub(crate) fn intersection(&mut self, solids: &[Solid], at: At) -> Result<Solid> {
        self.operation(solids, at, Node::All)
    }

    /// Adds a symmetric difference: points in an odd number of operands.
    pub(crate) fn xor(&mut self, solids: &[Solid], at: At) -> Result<Solid> {
        self.operation(solids, at, Node::Odd)
    }

    /// Adds a complement: points not in the operand.
    pub(crate) fn complement(&mut self, solid: Solid, at: At) -> Result<Solid> {
        self.push(Node::Not(solid.0), &[solid], at)
    }

    /// Adds a transformed solid.
    pub(crate) fn moved(&mut self, map: Affine, solid: Solid, at: At) -> Result<Solid> {
        self.maps.push(map);
        self.push(Node::Moved(self.maps.len() as u32 - 1, solid.0), &[solid], at)
    }

    /// Finishes the solid with its root node and the text that it was parsed from.
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

/// The graph of a solid.
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node>,
    pub(crate) links: Vec<u32>,
    pub(crate) maps: Vec<Affine>,
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) root: u32,
}

/// A solid of transformed and combined primitives, parsed from CSG text. `docs/csg.md` defines the
/// language.
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
    /// Parses a file: a CSG text, or a file of Bezier patches (`.bpt`), which becomes a CSG text.
    ///
    /// # Errors
    /// If it cannot be read, is not UTF-8, is longer than 8 MiB, or is not a valid solid.
    pub fn open(path: &Path) -> Result<Csg> {
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        // (One byte over the limit is enough to detect that the text is too long.)
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let place = format!("byte {}", error.utf8_error().valid_up_to());
            Error::corrupt(path, place, "bytes that are not UTF-8", "a CSG text in UTF-8")
        })?;
        if is_patch_file(path) { Csg::of_patches(path, &text) } else { Csg::parse(path, &text) }
    }

    /// Parses a text of Bezier patches (`.bpt`): the number of patches, and for each its degrees
    /// (`3 3` or `2 2`) and its 16 or 9 control points. Error messages name `path`.
    ///
    /// # Errors
    /// If it is malformed, or the patches do not enclose a solid. The error reports line and
    /// column.
    pub(crate) fn of_patches(path: &Path, text: &str) -> Result<Csg> {
        check_length(path, text)?;
        let (patches, csg) = csg_of_patches(path, text)?;
        // (Results record the CSG text, and it must be readable.)
        check_length(path, &csg)?;
        let mut builder = Builder::new(path);
        let root = solid_of_patches(&mut builder, path, patches, At { line: 1, column: 1 })?;
        builder.finish(&csg, root, None, None)
    }

    /// Parses a CSG text. Error messages name `path`.
    ///
    /// # Errors
    /// If it is not a valid solid. The error reports line and column, and what was found and
    /// expected there.
    pub fn parse(path: &Path, text: &str) -> Result<Csg> {
        parse(path, text)
    }

    /// Returns the CSG text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns the unit of length that the text declares.
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Returns the number of primitives. Primitives of a named solid count each time the name is
    /// used.
    pub fn primitives(&self) -> usize {
        self.lowered.instances.len()
    }

    /// Returns the number of primitives in words.
    pub(crate) fn counted(&self) -> String {
        match self.primitives() {
            1 => "1 primitive".into(),
            count => format!("{count} primitives"),
        }
    }

    /// Whether a file name has the extension of CSG text, `.csg`, or of patches, `.bpt`.
    pub fn is_name(path: &Path) -> bool {
        is_patch_file(path) || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csg"))
    }
}
