//! Colour roles of channels: red, green, blue, opacity, or not displayed.

use super::metadata::Metadata;
use super::tag::Tag;

/// Role names without information.
const PLAIN: [&str; 4] = ["", "Undefined", "Gray", "Palette"];

impl Metadata {
    /// Returns the role of each channel by its GDAL name ("Red", "NIR", "Undefined").
    ///
    /// Empty if the channels have their usual roles: grey, or red, green and blue; opacity where
    /// [`Metadata::alpha`] says so.
    pub fn colour_roles(&self) -> Vec<&str> {
        self.tag(Tag::ColourRoles).map_or(Vec::new(), |roles| roles.split(',').collect())
    }

    /// Stores the roles of all channels, unless they are the usual ones. An empty string is an
    /// unknown role.
    pub fn set_colour_roles(&mut self, roles: &[String]) {
        let usual = |channel: usize, role: &str| match channel {
            channel if self.alpha.map(usize::from) == Some(channel) => role == "Alpha",
            0..=2 if roles.len() >= 3 => role == ["Red", "Green", "Blue"][channel],
            _ => false,
        };
        let is_informative =
            |(channel, role): (usize, &String)| !PLAIN.contains(&&**role) && !usual(channel, role);
        if !roles.iter().enumerate().any(is_informative) {
            return;
        }
        // Role names contain no comma, which is the separator.
        let name = |role: &String| if role.is_empty() { "Undefined".into() } else { role.replace(',', " ") };
        self.set_tag(Tag::ColourRoles, roles.iter().map(name).collect::<Vec<_>>().join(","));
    }

    /// Indices of the channels to display as red, green and blue: those with these roles, or else
    /// the first three.
    pub fn rgb_channels(&self) -> [usize; 3] {
        let roles = self.colour_roles();
        let channel = |role: &str| roles.iter().position(|other| other.eq_ignore_ascii_case(role));
        match ["Red", "Green", "Blue"].map(channel) {
            // Values have at most four channels, but a tag may contain anything.
            [Some(red @ 0..4), Some(green @ 0..4), Some(blue @ 0..4)] => [red, green, blue],
            _ => [0, 1, 2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn roles(names: &str, alpha: Option<u8>) -> Metadata {
        let mut metadata = Metadata { alpha, ..Metadata::default() };
        metadata.set_colour_roles(&names.split(',').map(String::from).collect::<Vec<_>>());
        metadata
    }

    #[test]
    fn usual_roles_are_not_stored() {
        for (usual, alpha) in [
            ("Gray", None),
            ("Palette", None),
            (",,", None),
            ("Red,Green,Blue", None),
            ("Red,Green,Blue,Undefined", None),
            ("Red,Green,Blue,Alpha", Some(3)),
            ("Gray,Alpha", Some(1)),
            ("Gray,Undefined,Undefined,Undefined", None),
        ] {
            assert_eq!(roles(usual, alpha), Metadata { alpha, ..Metadata::default() }, "{usual}");
            assert_eq!(roles(usual, alpha).rgb_channels(), [0, 1, 2]);
        }
    }

    #[test]
    fn others_are() {
        let infrared = roles("Red,Green,Blue,NIR", None);
        assert_eq!((infrared.colour_roles().len(), infrared.rgb_channels()), (4, [0, 1, 2]));
        assert_eq!(roles("NIR,Red,Green,Blue", None).rgb_channels(), [1, 2, 3]);
        assert_eq!(roles("Blue,Green,Red", None).rgb_channels(), [2, 1, 0]);
        assert_eq!(roles("NIR,Red,Green", None).rgb_channels(), [0, 1, 2]);
        assert_eq!(roles("NIR,", None).colour_roles(), ["NIR", "Undefined"]);
    }
}
