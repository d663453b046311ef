//! Reader of mapping files, TOML or JSON.

use std::path::Path;

use umo_core_rig::glb::Given;

use crate::failure::Failure;

/// Reads a mapping file.
///
/// # Errors
/// The position and description of the first error.
pub(crate) fn read(path: &Path) -> Result<Given, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let text = umo_core_base::file::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
    let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    parse(&text, json).map_err(wrong)
}

/// Parses a mapping file's text.
pub(crate) fn parse(text: &str, json: bool) -> Result<Given, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    match json {
        true => serde_json::from_str(text).map_err(|error| error.to_string()),
        false => toml::from_str(text).map_err(|error| error.to_string()),
    }
}
