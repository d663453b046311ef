//! Reads `.glb` and `.gltf`: the container, the relevant parts of its JSON, and numeric data in its buffer.
//!
//! Files are untrusted: everything is checked before use, and unknown parts are left alone.
//!
//! | module | contents |
//! | --- | --- |
//! | `document` | the JSON: nodes, meshes, skins, accessors, animations |
//! | `pack` | files in several parts, or compressed, repacked as one plain file |
//! | `meshopt` | meshopt decoders |
//! | `splice` | JSON edited in some places and preserved verbatim in all others |
//! | `accessor` | numbers in the buffer |
//! | `character` | a character, and its rig |
//! | `bind` | joint transforms in the bind pose |
//! | `vrm` | the bone table of VRM files |
//! | `clip` | a character's animation, as motion of the 55 joints |
//! | `expressions` | the expression table of VRM files |
//! | `faces` | blendshapes that move |
//! | `follower` | a character that follows a stream of poses |
//! | `given` | a mapping file |
//! | `surface` | points spread over a character's meshes |

pub mod accessor;
mod bind;
mod character;
pub mod clip;
pub mod document;
mod expressions;
mod faces;
mod follower;
mod given;
mod meshopt;
mod pack;
pub mod splice;
mod surface;
mod vrm;

use umo_core_base::memory::with_capacity;

pub use character::{Character, Transform, transform};
pub use expressions::expressions;
pub use faces::Faces;
pub use follower::{FollowScratch, Follower, nodes};
pub use given::Given;
pub use pack::packed;
#[cfg(feature = "files")]
pub use pack::read;
pub use surface::spread;

const MAGIC: &[u8; 4] = b"glTF";
const JSON: &[u8; 4] = b"JSON";
const BIN: &[u8; 4] = b"BIN\0";

/// The chunks of a file.
#[derive(Clone, Copy, Debug)]
pub struct Glb<'a> {
    /// The first chunk.
    pub json: &'a str,
    /// The second chunk; empty if absent.
    pub bin: &'a [u8],
    /// All later chunks, which are passed through.
    pub more: &'a [u8],
}

impl<'a> Glb<'a> {
    /// Splits a file into its chunks.
    ///
    /// # Errors
    /// The violation of the format.
    pub fn split(bytes: &'a [u8]) -> Result<Self, String> {
        let (magic, rest) = bytes.split_first_chunk::<4>().ok_or("not a glb file")?;
        if magic != MAGIC {
            return Err("not a glb file".to_owned());
        }
        let (version, rest) = word(rest)?;
        if version != 2 {
            return Err(format!("it is glTF version {version}, expected 2"));
        }
        let (length, rest) = word(rest)?;
        let inside = length.checked_sub(12).and_then(|length| rest.get(..length));
        let (kind, json, rest) = chunk(inside.ok_or("the file is cut short")?)?;
        if kind != JSON {
            return Err("its first chunk is not JSON".to_owned());
        }
        let json = std::str::from_utf8(json).map_err(|_| "its JSON is not UTF-8")?;
        let (bin, more) = match chunk(rest) {
            Ok((kind, bin, more)) if kind == BIN => (bin, more),
            _ if rest.is_empty() => (rest, rest),
            Ok(_) => (&[][..], rest),
            Err(problem) => return Err(problem),
        };
        Ok(Self { json, bin, more })
    }
}

/// A chunk's type, its contents, and the bytes after it.
type Chunk<'a> = (&'a [u8; 4], &'a [u8], &'a [u8]);

/// Reads a little-endian number and returns it with the remaining bytes.
fn word(bytes: &[u8]) -> Result<(usize, &[u8]), String> {
    let (word, rest) = bytes.split_first_chunk().ok_or("the file is cut short")?;
    Ok((u32::from_le_bytes(*word) as usize, rest))
}

fn chunk(bytes: &[u8]) -> Result<Chunk<'_>, String> {
    let (length, rest) = word(bytes)?;
    let (kind, rest) = rest.split_first_chunk().ok_or("the file is cut short")?;
    let (inside, rest) = rest.split_at_checked(length).ok_or("the file is cut short")?;
    Ok((kind, inside, rest))
}

/// Builds a file of these chunks; `more` holds complete ones.
///
/// # Errors
/// The file would be larger than the format allows.
pub fn container(mut json: Vec<u8>, bin: &[u8], more: &[u8]) -> Result<Vec<u8>, String> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + bin.len() + more.len();
    let word = |length: usize| {
        let large = "the file would be larger than a glb file can be, 4 GiB";
        u32::try_from(length).map(u32::to_le_bytes).map_err(|_| large.to_owned())
    };
    let mut out = with_capacity(total);
    out.extend(b"glTF");
    out.extend(2_u32.to_le_bytes());
    out.extend(word(total)?);
    for (kind, chunk) in [(b"JSON", json.as_slice()), (b"BIN\0", bin)] {
        out.extend(word(chunk.len())?);
        out.extend(kind);
        out.extend(chunk);
    }
    out.extend(more);
    Ok(out)
}
