//! Wavefront OBJ.

use std::io::Write;

use super::sink::{Sink, Vertex, failed};
use spinney_base::Result;
use spinney_base::io::Output;

/// Name in the form in which lines have it. A line break would end it, a trailing backslash would
/// continue the line, and readers drop outer blanks.
pub(super) fn line_name(name: &str) -> String {
    let mut name = name.trim_matches(' ').replace(|letter: char| letter.is_control(), "_");
    if name.ends_with('\\') {
        name.pop();
        name.push('_');
    }
    name
}

/// OBJ output. Faces may follow their vertices immediately, so everything is written in call order.
pub(super) struct Obj {
    output: Output,
}

impl Obj {
    pub(super) fn new(output: Output) -> Result<Obj> {
        Obj::with_library(output, None)
    }

    /// Starts a file with the name of the library that has its materials, if there is one.
    pub(super) fn with_library(output: Output, library: Option<&str>) -> Result<Obj> {
        let mut obj = Obj { output };
        obj.line("# made by spinney".into())?;
        library.map_or(Ok(()), |name| obj.line(format!("mtllib {name}")))?;
        Ok(obj)
    }

    fn line(&mut self, mut line: String) -> Result<()> {
        line.push('\n');
        self.output.write_all(line.as_bytes()).map_err(|cause| failed(self.output.path())(cause))
    }
}

impl Sink for Obj {
    fn vertex(&mut self, [x, y, z]: [f64; 3]) -> Result<()> {
        self.line(format!("v {x} {y} {z}"))
    }

    fn coloured_vertex(&mut self, [x, y, z]: [f64; 3], colour: [u8; 3]) -> Result<()> {
        let [red, green, blue] = colour.map(|channel| f64::from(channel) / 255.0);
        self.line(format!("v {x} {y} {z} {red} {green} {blue}"))
    }

    fn part(&mut self, name: &str) -> Result<()> {
        self.line(format!("o {}", line_name(name)))
    }

    fn material(&mut self, name: &str) -> Result<()> {
        // (Without a name, faces are white.)
        self.line(format!("usemtl {}", line_name(name)).trim_end().into())
    }

    fn face(&mut self, corners: &[Vertex], _: u32) -> Result<()> {
        let mut line = String::from("f");
        for corner in corners {
            line.push(' ');
            // Indices start at 1.
            line.push_str(&(corner.index + 1).to_string());
        }
        self.line(line)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.output.commit()
    }
}
