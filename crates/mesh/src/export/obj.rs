//! Wavefront OBJ.

use std::io::Write;

use super::sink::{Sink, Vertex, failed};
use spinney_base::Result;
use spinney_base::io::Output;

/// A face may stand as soon as its vertices do, so everything is written as it comes.
pub(super) struct Obj {
    output: Output,
}

impl Obj {
    pub(super) fn new(output: Output) -> Result<Obj> {
        let mut obj = Obj { output };
        obj.line("# made by spinney".into())?;
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
        // A line ends with the line, and goes on behind a backslash.
        let mut name = name.replace(|letter: char| letter.is_control(), "_");
        if name.ends_with('\\') {
            name.pop();
            name.push('_');
        }
        self.line(format!("o {name}"))
    }

    fn face(&mut self, corners: &[Vertex], _: u32) -> Result<()> {
        let mut line = String::from("f");
        for corner in corners {
            line.push(' ');
            // Counted from 1.
            line.push_str(&(corner.index + 1).to_string());
        }
        self.line(line)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.output.commit()
    }
}
