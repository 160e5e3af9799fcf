//! Minimal XML parser, sufficient for GDAL's documents. It builds no document: elements are slices
//! of the text. It expands only the five predefined entities and character references. Malformed
//! markup ends the search.

/// An element of a document.
#[derive(Clone, Copy)]
pub(super) struct XmlElement<'a> {
    pub(super) name: &'a str,
    /// The section of the tag after the name.
    attributes: &'a str,
    /// The text between the tags.
    pub(super) content: &'a str,
}

/// A markup token.
enum Markup<'a> {
    /// A start tag: the text between its brackets.
    Start(&'a str),
    /// The tag of an empty element: the text between its brackets.
    Empty(&'a str),
    End,
    /// Verbatim text (CDATA), without entities.
    Data(&'a str),
    /// Comments, instructions and declarations.
    Other,
}

impl<'a> XmlElement<'a> {
    /// A document as an element whose child is the root.
    pub(super) fn document(text: &'a str) -> XmlElement<'a> {
        XmlElement { name: "", attributes: "", content: text }
    }

    /// The child elements.
    pub(super) fn children(&self) -> impl Iterator<Item = XmlElement<'a>> + use<'a> {
        let content = self.content;
        let mut at = 0;
        std::iter::from_fn(move || {
            loop {
                let (_, markup, end) = next_markup(content, at)?;
                at = end;
                match markup {
                    Markup::Empty(tag) => return Some(XmlElement::new(tag, "")),
                    Markup::Start(tag) => {
                        let (last, after) = end_of_element(content, end)?;
                        at = after;
                        return Some(XmlElement::new(tag, &content[end..last]));
                    }
                    _ => {}
                }
            }
        })
    }

    /// The child elements of this name.
    pub(super) fn named(&self, name: &'static str) -> impl Iterator<Item = XmlElement<'a>> + use<'a> {
        self.children().filter(move |child| child.name == name)
    }

    fn new(tag: &'a str, content: &'a str) -> XmlElement<'a> {
        let end = tag.find(|c: char| c.is_ascii_whitespace()).unwrap_or(tag.len());
        XmlElement { name: &tag[..end], attributes: &tag[end..], content }
    }

    pub(super) fn attribute(&self, name: &str) -> Option<String> {
        let mut rest = self.attributes;
        loop {
            let (key, value) = rest.split_once('=')?;
            let value = value.trim_start();
            let quote = value.chars().next().filter(|c| matches!(c, '"' | '\''))?;
            let (value, after) = value[1..].split_once(quote)?;
            if key.trim() == name {
                return Some(unescaped(value));
            }
            rest = after;
        }
    }

    /// The text of this element and its descendants.
    pub(super) fn text(&self) -> String {
        let (mut text, mut at) = (String::new(), 0);
        while let Some((start, markup, end)) = next_markup(self.content, at) {
            text += &unescaped(&self.content[at..start]);
            if let Markup::Data(data) = markup {
                text += data;
            }
            at = end;
        }
        text + &unescaped(&self.content[at..])
    }
}

/// Finds the first markup from `at` on: its start, the token, and its end. `None` if there is none,
/// or it is unterminated.
fn next_markup(text: &str, at: usize) -> Option<(usize, Markup<'_>, usize)> {
    const DATA: &str = "<![CDATA[";
    let start = at + text[at..].find('<')?;
    let rest = &text[start..];
    let up_to = |end: &str, from: usize| Some(from + rest.get(from..)?.find(end)? + end.len());
    let (markup, length) = if rest.starts_with(DATA) {
        let length = up_to("]]>", DATA.len())?;
        (Markup::Data(&rest[DATA.len()..length - 3]), length)
    } else if rest.starts_with("<!--") {
        (Markup::Other, up_to("-->", 4)?)
    } else if rest.starts_with("<?") {
        (Markup::Other, up_to("?>", 2)?)
    } else if rest.starts_with("<!") {
        (Markup::Other, up_to(">", 2)?)
    } else if rest.starts_with("</") {
        (Markup::End, up_to(">", 2)?)
    } else {
        let length = 1 + end_of_tag(&rest[1..])?;
        let tag = &rest[1..length];
        (tag.strip_suffix('/').map_or(Markup::Start(tag), Markup::Empty), length + 1)
    };
    Some((start, markup, start + length))
}

/// Index of the closing bracket of a start tag. Brackets in attribute values are skipped.
fn end_of_tag(tag: &str) -> Option<usize> {
    let mut quote = None;
    tag.bytes().position(|byte| {
        match (quote, byte) {
            (None, b'>') => return true,
            (None, b'"' | b'\'') => quote = Some(byte),
            (Some(open), byte) if open == byte => quote = None,
            _ => {}
        }
        false
    })
}

/// Finds start and end of an element's end tag; the element's content begins at `at`.
fn end_of_element(text: &str, mut at: usize) -> Option<(usize, usize)> {
    let mut open = 1u64;
    loop {
        let (start, markup, end) = next_markup(text, at)?;
        match markup {
            Markup::Start(_) => open += 1,
            Markup::End if open == 1 => return Some((start, end)),
            Markup::End => open -= 1,
            _ => {}
        }
        at = end;
    }
}

/// Replaces entities by characters; unknown entities are kept.
pub(super) fn unescaped(text: &str) -> String {
    /// Maximum number of characters between `&` and `;`.
    const LONGEST: usize = 8;
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(start) = rest.find('&') {
        out += &rest[..start];
        rest = &rest[start + 1..];
        let end = rest.bytes().take(LONGEST + 1).position(|byte| byte == b';');
        match end.and_then(|end| Some((entity(&rest[..end])?, end))) {
            Some((character, end)) => {
                out.push(character);
                rest = &rest[end + 1..];
            }
            None => out.push('&'),
        }
    }
    out + rest
}

fn entity(name: &str) -> Option<char> {
    Some(match name {
        "lt" => '<',
        "gt" => '>',
        "amp" => '&',
        "quot" => '"',
        "apos" => '\'',
        _ => {
            let number = name.strip_prefix('#')?;
            let code = match number.strip_prefix('x') {
                Some(hex) => u32::from_str_radix(hex, 16),
                None => number.parse(),
            };
            char::from_u32(code.ok()?)?
        }
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn elements_attributes_and_strings() {
        let text = "<?xml version=\"1.0\"?><!-- <A>no</A> --><A b = 'x > \"y\"' c=\"&lt;&#xe9;&#65;\">
            t &amp; u<B/><C><B>inner</B></C><![CDATA[<&amp;>]]><B d=\"1\">last &unknown; &amp</B></A>";
        let root = XmlElement::document(text).children().next().unwrap();
        assert_eq!(root.name, "A");
        assert_eq!(root.attribute("b").as_deref(), Some("x > \"y\""));
        assert_eq!(root.attribute("c").as_deref(), Some("<éA"));
        assert_eq!(root.attribute("d"), None);
        let names: Vec<&str> = root.children().map(|child| child.name).collect();
        assert_eq!(names, ["B", "C", "B"]);
        let strings: Vec<String> = root.named("B").map(|child| child.text()).collect();
        assert_eq!(strings, ["", "last &unknown; &amp"]);
        assert_eq!(root.text().trim(), "t & uinner<&amp;>last &unknown; &amp");
    }

    #[test]
    fn unclosed_elements_are_omitted() {
        for text in
            ["<A", "<A>", "<A><B></B>", "<A b=\"></A>", "<!-- <A></A>", "</A>", "<", "a", "<![CDATA[<A/>"]
        {
            assert_eq!(XmlElement::document(text).children().count(), 0, "{text}");
        }
        // Nesting may be arbitrarily deep: the parser does not recurse.
        let deep = "<A>".repeat(100_000) + &"</A>".repeat(100_000);
        assert_eq!(XmlElement::document(&deep).children().count(), 1);
    }

    proptest! {
        #[test]
        fn malformed_xml_does_not_panic(text in "[<>/!?&;#xA\"'= \\-\\[\\]é]{0,60}") {
            let mut pending = vec![XmlElement::document(&text)];
            while let Some(element) = pending.pop() {
                element.text();
                element.attribute("A");
                pending.extend(element.children());
            }
        }
    }
}
