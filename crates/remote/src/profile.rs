//! Settings of S3 in the files of its own programs (`~/.aws/credentials` and `~/.aws/config`).

use std::path::PathBuf;

/// Settings of the profile that `AWS_PROFILE` names (`default` if it names none), by the names that they have in the environment. There
/// are none where the environment has keys of its own.
pub(super) fn settings() -> Vec<(String, String)> {
    if std::env::var_os("AWS_ACCESS_KEY_ID").is_some() {
        return Vec::new();
    }
    let profile = std::env::var("AWS_PROFILE").unwrap_or_else(|_| "default".into());
    let mut settings = Vec::new();
    for (variable, file, heading) in [
        (
            "AWS_CONFIG_FILE",
            "config",
            if profile == "default" { profile.clone() } else { format!("profile {profile}") },
        ),
        ("AWS_SHARED_CREDENTIALS_FILE", "credentials", profile.clone()),
    ] {
        let home = || std::env::home_dir().map(|home| home.join(".aws").join(file));
        let Some(path) = std::env::var_os(variable).map(PathBuf::from).or_else(home) else { continue };
        // (A file that is not there, or that others may read alone, has nothing to say.)
        settings.extend(section(&std::fs::read_to_string(path).unwrap_or_default(), &heading));
    }
    settings
}

/// The settings of a section that are known, by their names in the environment.
fn section(text: &str, heading: &str) -> Vec<(String, String)> {
    let mut is_inside = false;
    let mut settings = Vec::new();
    for line in text.lines().map(str::trim) {
        if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            is_inside = name.trim() == heading;
        } else if is_inside && let Some((key, value)) = line.split_once('=') {
            let name = match key.trim() {
                key @ ("aws_access_key_id" | "aws_secret_access_key" | "aws_session_token") => key,
                "region" => "aws_region",
                "endpoint_url" => "aws_endpoint_url",
                _ => continue,
            };
            settings.push((name.to_string(), value.trim().to_string()));
        }
    }
    settings
}

/// Whether the environment says that requests are not signed, as other programs have it.
pub(super) fn is_unsigned() -> bool {
    let says_so = |value: String| ["yes", "true", "on", "1"].contains(&value.to_ascii_lowercase().as_str());
    std::env::var("AWS_NO_SIGN_REQUEST").is_ok_and(says_so)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_one_profile_are_read() {
        let text = "[default]\naws_access_key_id = A\n\n[work]\naws_access_key_id=B\nregion = eu-north-1\noutput = json\n";
        let pair = |key: &str, value: &str| (key.to_string(), value.to_string());
        assert_eq!(section(text, "work"), [pair("aws_access_key_id", "B"), pair("aws_region", "eu-north-1")]);
        assert_eq!(section(text, "default"), [pair("aws_access_key_id", "A")]);
        assert_eq!(section(text, "other"), []);
    }
}
