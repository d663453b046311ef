//! Repacks a character's file as one plain `.glb`: a `.gltf` with external files or embedded data, external buffers,
//! and views that meshopt compressed.

use std::borrow::Cow;

use data_encoding::BASE64;
use serde::Deserialize;
use serde_json::json;
use umo_core_base::memory::{self, with_capacity};

use super::splice::{Members, raw};
use super::{Glb, container, meshopt};

/// Upper bound on the size of the result, in bytes.
const MAX_BYTES: usize = 2 << 30;
/// Upper bound on the memory, in bytes, for parsing each byte of the JSON.
const MEMORY: usize = 32;

/// Remedy for messages about a view that cannot be decompressed.
const WAY_OUT: &str = "`npx @gltf-transform/cli copy in.glb out.glb` writes it without";

/// Names of the supported compression extension.
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// The parts of the JSON that locate the file's bytes.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Sources<'a> {
    #[serde(borrow)]
    buffers: Vec<Buffer<'a>>,
    buffer_views: Vec<View>,
    #[serde(borrow)]
    images: Vec<Image<'a>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Buffer<'a> {
    byte_length: usize,
    #[serde(borrow)]
    uri: Option<Cow<'a, str>>,
    #[serde(default)]
    extensions: Compressions,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    #[serde(default)]
    extensions: Compressions,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Image<'a> {
    #[serde(borrow)]
    uri: Option<Cow<'a, str>>,
}

/// The extension object of a buffer or a view, by either name.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Compressions {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    meshopt: Option<Compression>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Compression {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
    byte_stride: usize,
    count: usize,
    mode: String,
    filter: Option<String>,
    /// For a buffer: a placeholder for decompressed data, which may be absent.
    fallback: bool,
}

/// Returns the bytes of a `.glb` file unchanged, or a file in several parts as one `.glb`: external and embedded
/// buffers and images of a `.gltf` are included, and views that meshopt compressed are decompressed. `file` returns
/// the bytes of a file by its path relative to the character's. The path is checked to stay inside the character's
/// folder.
///
/// Unwinds to [`memory::catch`] if memory is exhausted.
///
/// # Errors
/// The file violates the format, or a buffer cannot be read (the error names it).
pub fn packed<'a>(
    bytes: &'a [u8],
    file: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
) -> Result<Cow<'a, [u8]>, String> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let is_text = text.trim_ascii_start().starts_with(b"{");
    let glb = match is_text {
        true => Glb { json: std::str::from_utf8(text).map_err(|_| "it is not UTF-8")?, bin: &[], more: &[] },
        false => Glb::split(bytes)?,
    };
    memory::require(MEMORY.saturating_mul(glb.json.len()).saturating_add(memory::SPARE));
    let sources: Sources<'_> = super::document::parse(glb.json)?;
    let is_plain = |buffer: &Buffer<'_>| buffer.uri.is_none();
    let compressed = sources.buffer_views.iter().any(|view| view.extensions.meshopt.is_some());
    if !is_text && !compressed && sources.buffers.len() <= 1 && sources.buffers.iter().all(is_plain) {
        return Ok(Cow::Borrowed(bytes));
    }
    let mut packing = Packing::new(&glb, &sources, file)?;
    packing.views()?;
    if is_text {
        packing.images(file)?;
    }
    packing.finish(glb.more).map(Cow::Owned)
}

/// State of the repacking.
struct Packing<'a> {
    sources: &'a Sources<'a>,
    /// By buffer; empty for a placeholder of decompressed data.
    buffers: Vec<Cow<'a, [u8]>>,
    members: Members,
    /// The views of the new file.
    views: Vec<Members>,
    bin: Vec<u8>,
}

impl<'a> Packing<'a> {
    fn new(
        glb: &Glb<'a>,
        sources: &'a Sources<'a>,
        file: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Self, String> {
        let mut buffers = Vec::with_capacity(sources.buffers.len());
        for (at, buffer) in sources.buffers.iter().enumerate() {
            let stands_in = buffer.extensions.meshopt.as_ref().is_some_and(|compression| compression.fallback);
            let bytes = match &buffer.uri {
                _ if stands_in => Cow::Borrowed(&[][..]),
                Some(uri) => Cow::Owned(of_uri(uri, file).map_err(|problem| format!("its buffer {at}: {problem}"))?),
                None if at == 0 && !glb.bin.is_empty() => Cow::Borrowed(glb.bin),
                None if buffer.byte_length == 0 => Cow::Borrowed(&[][..]),
                None => return Err(format!("its buffer {at}: it has no data")),
            };
            if bytes.len() < buffer.byte_length && !stands_in {
                let (got, want) = (bytes.len(), buffer.byte_length);
                return Err(format!("its buffer {at}: cut short, {got} of {want} bytes are there"));
            }
            buffers.push(bytes);
        }
        let members = Members::parse(glb.json)?;
        Ok(Self { sources, buffers, members, views: Vec::new(), bin: Vec::new() })
    }

    /// Copies the bytes of every view to the single buffer.
    fn views(&mut self) -> Result<(), String> {
        let total: usize = self.sources.buffer_views.iter().map(|view| view.byte_length.saturating_add(3)).sum();
        if total > MAX_BYTES {
            return Err(format!("its views are larger than {} GiB", MAX_BYTES >> 30));
        }
        self.bin = with_capacity(total);
        let written = self.members.list("bufferViews")?;
        for (at, (view, text)) in self.sources.buffer_views.iter().zip(written).enumerate() {
            let wrong = |problem: String| format!("its view {at}: {problem}");
            let mut members = Members::parse(text.get())?;
            self.bin.resize(self.bin.len().next_multiple_of(4), 0);
            members.set("buffer", raw(&json!(0)));
            members.set("byteOffset", raw(&json!(self.bin.len())));
            match &view.extensions.meshopt {
                Some(compression) => {
                    let start = self.bin.len();
                    let data = self.slice(compression.buffer, compression.byte_offset, compression.byte_length);
                    let data = data.map_err(wrong)?.to_vec();
                    self.bin.resize(start + view.byte_length, 0);
                    let help = |problem| wrong(format!("{}: {problem}; {WAY_OUT}", MESHOPT[0]));
                    decompress(compression, &data, &mut self.bin[start..]).map_err(help)?;
                    members.prune("extensions", &MESHOPT)?;
                }
                None => {
                    let bytes = self.slice(view.buffer, view.byte_offset, view.byte_length).map_err(wrong)?.to_vec();
                    self.bin.extend(bytes);
                }
            }
            self.views.push(members);
        }
        Ok(())
    }

    fn slice(&self, buffer: usize, offset: usize, length: usize) -> Result<&[u8], String> {
        let bytes = self.buffers.get(buffer).ok_or_else(|| format!("there is no buffer {buffer}"))?;
        let end = offset.checked_add(length);
        let slice = end.and_then(|end| bytes.get(offset..end));
        slice.ok_or_else(|| format!("it reaches beyond buffer {buffer}"))
    }

    /// Copies the images of a `.gltf` to the buffer. An image that cannot be read keeps its URI, because motion does
    /// not need it.
    fn images(&mut self, file: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<(), String> {
        let mut images = self.members.list("images")?;
        for (image, text) in self.sources.images.iter().zip(&mut images) {
            let Some(bytes) = image.uri.as_ref().and_then(|uri| of_uri(uri, file).ok()) else { continue };
            let Some(kind) = image_kind(&bytes) else { continue };
            self.bin.resize(self.bin.len().next_multiple_of(4), 0);
            let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
            let mut members = Members::parse(text.get())?;
            members.remove("uri");
            members.set("mimeType", raw(&json!(kind)));
            members.set("bufferView", raw(&json!(self.views.len())));
            *text = members.into_raw();
            self.views.push(Members::parse(&view.to_string())?);
            self.bin.extend(bytes);
        }
        if !images.is_empty() {
            self.members.set_list("images", &images);
        }
        Ok(())
    }

    fn finish(mut self, more: &[u8]) -> Result<Vec<u8>, String> {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        if !self.views.is_empty() {
            let views: Vec<_> = self.views.into_iter().map(Members::into_raw).collect();
            self.members.set_list("bufferViews", &views);
        }
        match self.bin.len() {
            0 => self.members.remove("buffers"),
            length => self.members.set_list("buffers", &[raw(&json!({ "byteLength": length }))]),
        }
        for list in ["extensionsUsed", "extensionsRequired"] {
            self.members.prune(list, &MESHOPT)?;
        }
        container(self.members.text().into_bytes(), &self.bin, more)
    }
}

/// Decompresses a view into `out`.
fn decompress(compression: &Compression, data: &[u8], out: &mut [u8]) -> Result<(), String> {
    let &Compression { byte_stride: stride, count, ref mode, ref filter, .. } = compression;
    if count.checked_mul(stride) != Some(out.len()) {
        return Err(format!("{count} values of {stride} bytes are not its length, {}", out.len()));
    }
    if mode == "ATTRIBUTES" {
        meshopt::vertices(data, stride, out)?;
        return meshopt::unfilter(filter.as_deref().unwrap_or("NONE"), stride, out);
    }
    if stride != 2 && stride != 4 {
        return Err(format!("indices of {stride} bytes"));
    }
    let mut places = out.chunks_exact_mut(stride);
    let mut put = |index: u32| {
        if let Some(place) = places.next() {
            place.copy_from_slice(&index.to_le_bytes()[..stride]);
        }
    };
    match mode.as_str() {
        "TRIANGLES" => meshopt::triangles(data, count, &mut put),
        "INDICES" => meshopt::indices(data, count, &mut put),
        _ => Err(format!("its mode {mode} is unknown")),
    }
}

/// Returns the bytes of a URI: embedded in its text, or a file in the character's folder.
fn of_uri(uri: &str, file: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data.split_once(";base64,").ok_or("its data is not in base64")?;
        let length = BASE64.decode_len(text.len()).map_err(|_| "its base64 has a wrong length")?;
        let mut bytes = memory::filled(0, length);
        let written = BASE64.decode_mut(text.as_bytes(), &mut bytes).map_err(|_| "its base64 is malformed")?;
        bytes.truncate(written);
        return Ok(bytes);
    }
    let path = unescaped(uri)?;
    let scheme = path.split_once(':').map(|(scheme, _)| scheme);
    if let Some(scheme) = scheme {
        let way = "download it, put it beside the character, and write its name there";
        return Err(format!("`{}` is at another place ({scheme}:): {way}", shortened(uri)));
    }
    if path.starts_with(['/', '\\']) || path.split(['/', '\\']).any(|part| part == "..") {
        return Err(format!("`{}` is outside of the character's folder: put it beside the character", shortened(uri)));
    }
    file(&path).map_err(|problem| format!("`{}`: {problem}", shortened(uri)))
}

/// At most 120 bytes of a URI, for messages.
fn shortened(uri: &str) -> &str {
    &uri[..uri.floor_char_boundary(120)]
}

/// Decodes percent-escapes in a path.
fn unescaped(uri: &str) -> Result<String, String> {
    let mut bytes = with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        rest = after;
        let digits = (byte == b'%').then(|| after.split_first_chunk::<2>()).flatten();
        let escaped = digits.and_then(|(digits, _)| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
        if escaped.is_some() {
            rest = &after[2..];
        }
        bytes.push(escaped.unwrap_or(byte));
    }
    String::from_utf8(bytes).map_err(|_| format!("`{}` is not a valid path", shortened(uri)))
}

/// Media type of an image, detected from its first bytes.
fn image_kind(bytes: &[u8]) -> Option<&'static str> {
    let kinds: [(&[u8], &str); 4] = [
        (b"\x89PNG", "image/png"),
        (b"\xff\xd8\xff", "image/jpeg"),
        (b"RIFF", "image/webp"),
        (b"\xabKTX 20\xbb", "image/ktx2"),
    ];
    kinds.into_iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, kind)| kind)
}

/// Reads a character's file, with the external files that it references, as one `.glb`.
///
/// Unwinds to [`memory::catch`] if memory is exhausted.
///
/// # Errors
/// As [`packed`], or the I/O error of a file.
#[cfg(feature = "files")]
pub fn read(path: &std::path::Path) -> std::io::Result<Vec<u8>> {
    let read = |path: &std::path::Path| {
        if std::fs::metadata(path)?.len() > MAX_BYTES as u64 {
            return Err(std::io::Error::other(format!("it is larger than {} GiB", MAX_BYTES >> 30)));
        }
        umo_core_base::file::read(path)
    };
    let bytes = read(path)?;
    let folder = path.parent().unwrap_or(path);
    let packed = packed(&bytes, &mut |name| read(&folder.join(name)).map_err(|error| error.to_string()));
    let packed = match packed.map_err(std::io::Error::other)? {
        Cow::Borrowed(_) => None,
        Cow::Owned(packed) => Some(packed),
    };
    Ok(packed.unwrap_or(bytes))
}

#[cfg(test)]
mod tests;
