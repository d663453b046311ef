//! Tensors of all sources, under the names that a dense umo model would give them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use umo_core::Config;

use super::source::Source;
use crate::args::Convert;
use crate::failure::Failure;

/// Prefix of the language model trained by Language of Motion, in a checkpoint of all its parts.
const LOM_T5: &str = "lm.language_model.";
/// Prefixes of the codecs in files that hold several: Language of Motion's, then EMAGE's.
const CODECS: [(&str, &str); 11] = [
    ("vae_face.", "face"),
    ("vae_hand.", "hands"),
    ("vae_hands.", "hands"),
    ("vae_upper.", "upper"),
    ("vae_lower.", "lower"),
    ("vae_global.", "root"),
    ("vq_model_face.", "face"),
    ("vq_model_hands.", "hands"),
    ("vq_model_upper.", "upper"),
    ("vq_model_lower.", "lower"),
    ("global_motion.", "root"),
];
/// Prefixes of the other contents of a Language of Motion checkpoint: the language model, bodies
/// for measurements, and metrics.
const OTHERS: [&str; 6] = ["lm.", "smplx.", "flame.", "_losses.", "metrics.", "Metrics."];
const CODEBOOK: &str = "quantizer.embedding.weight";
const CENTROIDS: &str = "audio.kmeans.centroids";

/// A tensor of a source.
#[derive(Debug)]
pub(super) struct Entry {
    source: usize,
    /// Name in the source.
    name: String,
    /// Shape in the source.
    pub(super) shape: Vec<usize>,
}

/// All tensors of all sources.
#[derive(Debug)]
pub(super) struct Catalogue {
    sources: Vec<Source>,
    entries: BTreeMap<String, Entry>,
}

impl Catalogue {
    /// Reads the headers of all sources.
    pub(super) fn open(args: &Convert, config: &Config) -> Result<Self, Failure> {
        let mut catalogue = Self { sources: Vec::new(), entries: BTreeMap::new() };
        catalogue.hubert(open(&args.hubert)?)?;
        catalogue.centroids(Source::open_all(&args.centroids)?)?;
        catalogue.t5(open(&args.t5)?)?;
        for source in open(&args.vq)? {
            catalogue.vq(source, config)?;
        }
        for source in open(&args.depth)? {
            catalogue.depth(source)?;
        }
        for source in Source::open_all(&args.interp)? {
            catalogue.interp(source)?;
        }
        Ok(catalogue)
    }

    pub(super) fn get(&self, name: &str) -> Option<&Entry> {
        self.entries.get(name)
    }

    /// Returns all names.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// Reads all values of a tensor.
    pub(super) fn read(&self, entry: &Entry) -> Result<Vec<f32>, Failure> {
        self.sources[entry.source].read(&entry.name)
    }

    /// Returns the location and name of a tensor in its source, for messages.
    pub(super) fn place(&self, entry: &Entry) -> String {
        format!("{}: tensor `{}`", self.sources[entry.source].path().display(), entry.name)
    }

    fn hubert(&mut self, sources: Vec<Source>) -> Result<(), Failure> {
        sources.into_iter().try_for_each(|source| {
            self.add(source, |name| Some(format!("audio.hubert.{}", name.strip_prefix("hubert.").unwrap_or(name))))
        })
    }

    fn centroids(&mut self, sources: Vec<Source>) -> Result<(), Failure> {
        sources.into_iter().try_for_each(|source| {
            let only = source.tensors().len() == 1;
            self.add(source, |name| (only || name == CENTROIDS).then(|| CENTROIDS.to_owned()))
        })
    }

    fn t5(&mut self, sources: Vec<Source>) -> Result<(), Failure> {
        let lom = sources.iter().flat_map(Source::tensors).any(|(name, _)| name.starts_with(LOM_T5));
        let prefix = if lom { LOM_T5 } else { "" };
        sources
            .into_iter()
            .try_for_each(|source| self.add(source, |name| Some(format!("lm.{}", name.strip_prefix(prefix)?))))
    }

    fn vq(&mut self, source: Source, config: &Config) -> Result<(), Failure> {
        let listed = |name: &str| listed_codec(name, config);
        if config.parts.is_some() && source.tensors().iter().any(|(name, _)| listed(name).is_some()) {
            return self.add(source, listed);
        }
        let several = source.tensors().iter().any(|(name, _)| codec(name).is_some());
        if several {
            return self.add(source, |name| match codec(name) {
                Some((part, name)) => Some(format!("vq.{part}.{name}")),
                None if OTHERS.iter().any(|other| name.starts_with(other)) => None,
                None => Some(format!("vq.{name}")),
            });
        }
        let part = only_codec(&source, config)?;
        self.add(source, |name| Some(format!("vq.{part}.{}", bare(name))))
    }

    /// Adds `depth.*` and `lm.frames.*` of a file.
    fn depth(&mut self, source: Source) -> Result<(), Failure> {
        let path = source.path().to_owned();
        let ours = |name: &str| ["depth.", "lm.frames."].iter().any(|prefix| name.starts_with(prefix));
        if !source.tensors().iter().any(|(name, _)| ours(name)) {
            let problem = "no depth network in it: neither depth.* nor lm.frames.*";
            return Err(Failure::input(format!("{}: {problem}", path.display())));
        }
        self.add(source, |name| ours(name).then(|| name.to_owned()))
    }

    fn interp(&mut self, source: Source) -> Result<(), Failure> {
        let prefixed = source.tensors().iter().any(|(name, _)| name.starts_with("interp."));
        self.add(source, |name| match (prefixed, name.starts_with("interp.")) {
            (true, false) => None,
            (true, true) => Some(name.to_owned()),
            (false, _) => Some(format!("interp.{name}")),
        })
    }

    /// Adds the tensors of `source` for which `ours` returns a name.
    fn add(&mut self, source: Source, ours: impl Fn(&str) -> Option<String>) -> Result<(), Failure> {
        let index = self.sources.len();
        let tensors = source.tensors();
        self.sources.push(source);
        for (name, shape) in tensors {
            let Some(key) = ours(&name) else { continue };
            let entry = Entry { source: index, name, shape };
            if let Some(first) = self.entries.get(&key) {
                let (first, again) = (self.place(first), self.place(&entry));
                return Err(Failure::input(format!("{again}: the same is in {first}")));
            }
            self.entries.insert(key, entry);
        }
        Ok(())
    }
}

fn open(paths: &[PathBuf]) -> Result<Vec<Source>, Failure> {
    let all: Vec<Vec<Source>> = paths.iter().map(|path| Source::open_all(path)).collect::<Result<_, _>>()?;
    Ok(all.into_iter().flatten().collect())
}

/// Returns the codec that a tensor name of a multi-codec file belongs to, and the rest of the name.
fn codec(name: &str) -> Option<(&'static str, &str)> {
    CODECS.iter().find_map(|(prefix, part)| Some((*part, name.strip_prefix(prefix)?)))
}

/// Returns the model's name of a codec tensor whose name begins with a part of the config's list or with
/// `root`, with or without a leading `vq.`.
fn listed_codec(name: &str, config: &Config) -> Option<String> {
    let own = name.strip_prefix("vq.").unwrap_or(name);
    let (part, rest) = own.split_once('.')?;
    let is_codec = ["quantizer.", "encoder.main.", "decoder.main."].iter().any(|start| rest.starts_with(start));
    let is_listed = part == "root" || config.part_list().iter().any(|listed| listed.name == part);
    (is_codec && is_listed).then(|| format!("vq.{own}"))
}

/// Returns a name without the prefix that PyTorch's `DataParallel` adds.
fn bare(name: &str) -> &str {
    name.strip_prefix("module.").unwrap_or(name)
}

/// Returns the part of a file with a single codec, identified by the channels of its last convolution; a
/// codec without a codebook is the root network.
fn only_codec(source: &Source, config: &Config) -> Result<String, Failure> {
    let tensors = source.tensors();
    let failure = |problem: String| Failure::input(format!("{}: {problem}", source.path().display()));
    let last = |name: &str| bare(name).strip_prefix("decoder.main.")?.strip_suffix(".bias")?.parse::<usize>().ok();
    let channels = tensors.iter().filter_map(|(name, shape)| Some((last(name)?, shape.first()?))).max();
    let Some((_, &channels)) = channels else {
        return Err(failure("no motion codec in it: no decoder.main.*".to_owned()));
    };
    if !tensors.iter().any(|(name, _)| bare(name) == CODEBOOK) {
        return Ok("root".to_owned());
    }
    let list = config.part_list().into_iter();
    let list: Vec<_> = list.filter_map(|part| Some((part.channels(&config.face)?.count(), part.name))).collect();
    let fitting: Vec<_> = list.iter().filter(|(count, _)| *count == channels).map(|(_, name)| name).collect();
    match fitting[..] {
        [name] => Ok(name.clone()),
        [] => {
            let sizes = list.iter().map(|(count, name)| format!("{name} {count}")).collect::<Vec<_>>().join(", ");
            Err(failure(format!("a codec of {channels} channels, where the config has {sizes}")))
        }
        [first, ..] => {
            let names = fitting.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(" or ");
            Err(failure(format!(
                "a codec of {channels} channels may be of {names}: put the part's name before its tensors' names, as \
                 `{first}.decoder.main.0.model.0.weight`"
            )))
        }
    }
}
