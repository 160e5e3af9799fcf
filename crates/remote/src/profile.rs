//! S3 settings from the files of the AWS tools (`~/.aws/credentials` and `~/.aws/config`).

use std::path::PathBuf;

/// Returns the settings of the profile `AWS_PROFILE` (`default` if unset), named like environment
/// variables in lower case. Empty if the environment contains keys itself.
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
        // A missing or unreadable file has no settings.
        settings.extend(section(&std::fs::read_to_string(path).unwrap_or_default(), &heading));
    }
    settings
}

/// Known settings of a section, named like environment variables in lower case.
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

/// Returns whether the environment disables request signing, by the variable that GDAL uses.
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
