//! Conversion of a host's clip for the writers, and output of the file's bytes.

use std::ffi::c_void;
use std::io::{self, Write};

use umo_core::{Face, FaceKind, JOINTS, Skeleton};
use umo_core_base::memory;
use umo_core_pose::clip::Clip;
use umo_figure::Figure;
use umo_gltf::{glb, vrma};

use super::{UMO_FORMAT_GLB, UMO_FORMAT_VRMA, UmoClip, UmoOutput};
use crate::ffi;
use crate::frame::Given;
use crate::status::{Failure, UMO_STATUS_IO};

/// Maximum number of face channels.
const MAX_CHANNELS: usize = 1024;
/// Maximum number of frames: a file of 4 GiB, glTF's limit, holds no more rotations and translations.
const MAX_FRAMES: usize = u32::MAX as usize / (size_of::<f32>() * (4 * JOINTS + 3));

/// Memory in bytes for making and writing a figure: 13 MB were measured.
const FIGURE: usize = 16 << 20;

/// A clip and the format to write it in.
struct Content {
    clip: Clip,
    format: Format,
}

enum Format {
    Glb(Option<Figure>),
    Vrma,
}

/// # Safety
/// As `umo_clip_write`.
pub(super) unsafe fn to_output(clip: *const UmoClip, format: u32, output: *const UmoOutput) -> Result<(), Failure> {
    // SAFETY: guaranteed by the caller (see # Safety).
    let output = unsafe { crate::read_if_given(output, "output")? }.ok_or_else(|| Failure::null("output"))?;
    let write = output.write.ok_or_else(|| Failure::null("output.write"))?;
    // SAFETY: guaranteed by the caller (see # Safety).
    let content = unsafe { Content::read(clip, format)? };
    let mut host = Host { userdata: output.userdata, write, answer: 0 };
    memory::catch(|| content.write(&mut host))?.map_err(|cause| match host.answer {
        0 => refused(&cause),
        answer => {
            Failure::new(UMO_STATUS_IO, format_args!("`output.write` returned {answer}: nothing more was written"))
        }
    })
}

/// # Safety
/// As `umo_clip_write_file`.
#[cfg(feature = "files")]
pub(super) unsafe fn to_file(clip: *const UmoClip, format: u32, path: &str) -> Result<(), Failure> {
    let unwritten = |cause| Failure::io(&cause, format_args!("cannot write {path}: {cause}"));
    // SAFETY: guaranteed by the caller (see # Safety).
    let content = unsafe { Content::read(clip, format)? };
    let file = memory::watch(|| umo_core_base::file::AtomicFile::create(path.as_ref()))?.map_err(unwritten)?;
    let no_memory = |_| Err(io::ErrorKind::OutOfMemory.into());
    let written = file.commit(|out| memory::catch(|| content.write(out)).unwrap_or_else(no_memory));
    written.map_err(|cause| match cause.kind() {
        io::ErrorKind::InvalidInput => refused(&cause),
        _ => unwritten(cause),
    })
}

/// # Safety
/// As `umo_clip_write_file`.
#[cfg(not(feature = "files"))]
pub(super) unsafe fn to_file(_: *const UmoClip, _: u32, path: &str) -> Result<(), Failure> {
    Err(Failure::no_files(path, "umo_clip_write"))
}

/// Converts a writer's error: the clip cannot be stored in the format, or there is not enough memory.
fn refused(cause: &io::Error) -> Failure {
    match cause.kind() {
        io::ErrorKind::OutOfMemory => Failure::io(cause, cause),
        _ => Failure::argument(format_args!("`clip`: {cause}")),
    }
}

impl Content {
    /// # Safety
    /// `clip` is NULL or as long as its `struct_size` says, and its pointers are as described.
    unsafe fn read(clip: *const UmoClip, format: u32) -> Result<Self, Failure> {
        // SAFETY: guaranteed by the caller (see # Safety).
        let given = unsafe { ffi::read(clip, "clip")? };
        let format = match format {
            // SAFETY: guaranteed by the caller (see # Safety).
            UMO_FORMAT_GLB => Format::Glb(unsafe { figure(&given)? }),
            UMO_FORMAT_VRMA => Format::Vrma,
            _ => return Err(Failure::argument(format_args!("format {format} is not one of UMO_FORMAT_…"))),
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        let clip = memory::catch(|| unsafe { read(&given) })??;
        clip.check().map_err(|what| Failure::argument(format_args!("`clip`: {what}")))?;
        Ok(Self { clip, format })
    }

    fn write(&self, out: impl Write) -> io::Result<()> {
        match self.format {
            Format::Glb(None) => glb::write(&self.clip, None, out),
            Format::Glb(figure) => {
                // Many pieces, each of them small.
                memory::require(FIGURE);
                glb::write(&self.clip, figure, out)
            }
            Format::Vrma => vrma::write(&self.clip, out),
        }
    }
}

/// # Safety
/// The clip's `figure` is NULL or ends with a zero byte.
unsafe fn figure(given: &UmoClip) -> Result<Option<Figure>, Failure> {
    if given.figure.is_null() {
        return Ok(None);
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let name = unsafe { ffi::string(given.figure, "clip.figure")? };
    name.parse().map(Some).map_err(Failure::argument)
}

/// # Safety
/// The clip's pointers are as described.
unsafe fn read(given: &UmoClip) -> Result<Clip, Failure> {
    let kind = match given.is_arkit {
        0 => FaceKind::SmplxExpression,
        1 => FaceKind::Arkit,
        other => return Err(Failure::argument(format_args!("`clip.is_arkit` is {other}: expected 0 or 1"))),
    };
    if given.reserved != 0 {
        return Err(Failure::argument("`clip.reserved` is not 0"));
    }
    let (frames, channels) = (given.frame_count as usize, given.channel_count as usize);
    if !(1..=MAX_FRAMES).contains(&frames) || channels > MAX_CHANNELS {
        let what = format_args!(
            "`clip` has {frames} frames and {channels} channels: expected 1 to {MAX_FRAMES} frames and at most \
             {MAX_CHANNELS} channels"
        );
        return Err(Failure::argument(what));
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let names = unsafe { ffi::slice(given.channels, channels, "clip.channels")? };
    // SAFETY: guaranteed by the caller (see # Safety), for each of them.
    let name = |&name| unsafe { ffi::string(name, "clip.channels") }.map(str::to_owned);
    let names = names.iter().map(name).collect::<Result<Vec<_>, _>>()?;
    // SAFETY: guaranteed by the caller (see # Safety).
    let parents = unsafe { ffi::slice(given.parents, JOINTS, "clip.parents")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let offsets = unsafe { ffi::slice(given.offsets, 3 * JOINTS, "clip.offsets")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let values = unsafe { Given::read(given.layout, given.frames, frames, channels)? };
    let mut clip = Clip {
        frame_rate: given.rate,
        skeleton: Skeleton { parents: parents.to_vec(), offsets_m: offsets.as_chunks().0.to_vec() },
        face: Face { kind, names },
        rotations: memory::with_capacity(frames),
        translation: memory::with_capacity(frames),
        face_values: memory::with_capacity(frames * channels),
    };
    for number in 0..frames {
        let pose = values.frame(number, &mut clip.face_values);
        clip.rotations.push(pose.rotations);
        clip.translation.push(pose.translation);
    }
    Ok(clip)
}

/// The host's `umo_output`.
struct Host {
    userdata: *mut c_void,
    write: unsafe extern "C" fn(userdata: *mut c_void, bytes: *const c_void, size: usize) -> i32,
    /// Last value that it returned.
    answer: i32,
}

impl Write for Host {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.is_empty() {
            return Ok(0);
        }
        // SAFETY: the host's function, called as documented.
        self.answer = unsafe { (self.write)(self.userdata, bytes.as_ptr().cast(), bytes.len()) };
        if self.answer == 0 { Ok(bytes.len()) } else { Err(io::Error::other("stopped")) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
