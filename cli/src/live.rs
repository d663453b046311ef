//! `umo live`: live speech in, poses out: to a page, or to other programs over the network.
//!
//! | module | part |
//! | --- | --- |
//! | `livelink` | faces as packets of the Live Link Face app |
//! | `vmc` | poses as messages of the VMC protocol |

mod livelink;
mod vmc;

use std::io::{self, Read};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, TryRecvError, channel};
use std::time::{Duration, Instant};

use umo_core::{
    AudioSource, Engine, Frame, MAX_RATE, MIN_RATE, Pushed, Session, SessionConfig, SessionError, Voice, WordRules,
};

use crate::args::{Live, VoiceArg};
use crate::failure::Failure;
use crate::speech::{Samples, Speech};
use crate::view::stream::{self, check_voice};
use crate::words::Script;
use crate::{animate, interrupt, model};

/// Delay before samples that found no room are pushed again.
const RETRY: Duration = Duration::from_millis(5);
/// Upper bound on the samples of a recording pushed at once.
const STRETCH: usize = 480;
/// Time allowed for computing, seconds: poses are shown this much later than the latency requires.
const MARGIN: f64 = 0.1;
/// Resampling target for recordings with a rate that sessions do not accept.
const OTHER_RATE: usize = 48_000;
/// Default sample rate of standard input.
const INPUT_RATE: usize = 16_000;

/// Serves a page until Ctrl-C, or sends poses until the speech ends or Ctrl-C.
pub(crate) fn run(args: &Live) -> Result<(), Failure> {
    if args.has_receivers() {
        return send(args);
    }
    #[cfg(feature = "serve")]
    return crate::view::live::run(args);
    #[cfg(not(feature = "serve"))]
    Err(Failure::input("expected --vmc or --livelink: this build has no server for a page"))
}

/// Sends poses to other programs.
fn send(args: &Live) -> Result<(), Failure> {
    let vmc = args.vmc.as_deref().map(|address| resolve("--vmc", address)).transpose()?;
    let livelink = args.livelink.as_deref().map(|address| resolve("--livelink", address)).transpose()?;
    let stop = interrupt::stop();
    let (source, rules) = Source::open(args)?;
    let rate = source.rate();
    let (engine, session) = session(args, rate, rules)?;
    let session = Arc::new(session);
    let mut receivers = Vec::new();
    let config = engine.model().config();
    if let Some(address) = vmc {
        let sender = vmc::Sender::new(config, args.hips)?;
        let datagrams = move |frame: &Frame, seconds| sender.packets(frame.pose, frame.face, seconds);
        receivers.push(Receiver::new(address, Box::new(datagrams))?);
    }
    if let Some(address) = livelink {
        let sender = livelink::Sender::new(config, args)?;
        let datagrams = move |frame: &Frame, seconds| Ok(vec![sender.packet(frame.pose, frame.face, seconds)]);
        receivers.push(Receiver::new(address, Box::new(datagrams))?);
    }
    // The reader may block on its pipe forever, so it is never joined.
    let (tell, ended) = channel();
    let (reader, until) = (Arc::clone(&session), Arc::clone(&stop));
    std::thread::spawn(move || {
        let read = source.speak(&reader, &until);
        let _ = tell.send(read);
    });
    let addresses: Vec<_> = receivers.iter().map(|receiver| receiver.address.to_string()).collect();
    eprintln!("sending to {}, {} times a second (Ctrl-C ends it)", addresses.join(" and "), args.fps);
    let send = |frame: Frame, seconds: f64| receivers.iter().try_for_each(|receiver| receiver.send(&frame, seconds));
    let sent = show(&session, rate, f64::from(args.fps), &stop, &ended, send)?;
    eprintln!("{sent} poses sent");
    Ok(())
}

/// Builds the datagrams of a pose shown at a time in seconds.
type Datagrams = dyn Fn(&Frame, f64) -> Result<Vec<Vec<u8>>, Failure>;

/// A program that receives every pose.
struct Receiver {
    address: SocketAddr,
    socket: UdpSocket,
    datagrams: Box<Datagrams>,
}

impl Receiver {
    fn new(address: SocketAddr, datagrams: Box<Datagrams>) -> Result<Self, Failure> {
        let socket = UdpSocket::bind(if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" })
            .map_err(|error| Failure::environment(format!("cannot open a socket: {error}")))?;
        Ok(Self { address, socket, datagrams })
    }

    /// Sends a pose shown at `seconds`.
    fn send(&self, frame: &Frame, seconds: f64) -> Result<(), Failure> {
        for datagram in (self.datagrams)(frame, seconds)? {
            match self.socket.send_to(&datagram, self.address) {
                Ok(_) => {}
                // No program listens yet, or it has quit.
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
                Err(error) => return Err(Failure::environment(format!("cannot send to {}: {error}", self.address))),
            }
        }
        Ok(())
    }
}

/// Returns the rate at which a recording is pushed to a session.
pub(crate) fn session_rate(rate: usize) -> usize {
    if (MIN_RATE..=MAX_RATE).contains(&rate) { rate } else { OTHER_RATE }
}

fn resolve(option: &str, address: &str) -> Result<SocketAddr, Failure> {
    let expected = || Failure::input(format!("{option} {address}: expected HOST:PORT, as 127.0.0.1:39539"));
    address.to_socket_addrs().map_err(|_| expected())?.next().ok_or_else(expected)
}

/// Source of the speech.
enum Source {
    /// Mono samples, pushed in real time, with their words before them.
    Recording { rate: usize, samples: Box<Samples>, script: Script },
    /// 16-bit mono samples from standard input, pushed as they arrive.
    Input { rate: usize },
}

impl Source {
    /// The source that the arguments name, and the rules of its words.
    fn open(args: &Live) -> Result<(Self, Option<WordRules>), Failure> {
        let Some(path) = args.input.as_deref().filter(|&path| path != Path::new("-")) else {
            let rate = args.rate.unwrap_or(INPUT_RATE);
            if !(MIN_RATE..=MAX_RATE).contains(&rate) {
                return Err(Failure::input(format!("--rate {rate}: expected {MIN_RATE} to {MAX_RATE}")));
            }
            args.words.refuse_with("standard input: the words would have to be known before it")?;
            return Ok((Self::Input { rate }, None));
        };
        if args.rate.is_some() {
            return Err(Failure::input("--rate is for standard input: a recording has its own"));
        }
        let speech = Speech::open(path, args.repair)?;
        let rate = session_rate(speech.sample_rate());
        let (script, rules) = Script::of(&args.words, &speech)?.unzip();
        let samples = Box::new(speech.samples(rate)?);
        Ok((Self::Recording { rate, samples, script: script.unwrap_or_default() }, rules))
    }

    const fn rate(&self) -> usize {
        match *self {
            Self::Recording { rate, .. } | Self::Input { rate } => rate,
        }
    }

    /// Pushes all samples to the session, then finishes its stream.
    fn speak(self, session: &Session, stop: &AtomicBool) -> Result<(), Failure> {
        match self {
            Self::Recording { rate, mut samples, mut script } => {
                let start = Instant::now();
                let (mut spoken, mut block) = (0, Vec::new());
                while samples.pull(&mut block)? {
                    for stretch in block.chunks(STRETCH) {
                        script.give(|text, start, end| session.hint_words(text, start, end))?;
                        push(stop, stretch.len(), |done| session.push_audio(&stretch[done..]))?;
                        spoken += stretch.len();
                        let due = Duration::from_secs_f64(spoken as f64 / rate as f64);
                        std::thread::sleep(due.saturating_sub(start.elapsed()));
                    }
                    block.clear();
                }
            }
            Self::Input { .. } => hear(session, &mut io::stdin().lock(), stop)?,
        }
        session.finish().map_err(Failure::environment)
    }
}

/// Reads 16-bit little-endian samples until end of file.
fn hear(session: &Session, input: &mut impl Read, stop: &AtomicBool) -> Result<(), Failure> {
    let (mut bytes, mut kept) = ([0; 2 * STRETCH], 0);
    loop {
        let read = match input.read(&mut bytes[kept..]) {
            Ok(0) => return Ok(()),
            Ok(read) => read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(Failure::environment(format!("cannot read standard input: {error}"))),
        };
        let whole = (kept + read) / 2;
        let samples: Vec<i16> = bytes[..2 * whole].chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect();
        push(stop, whole, |done| session.push_audio_i16(&samples[done..]))?;
        // An odd byte waits for the second half of its sample.
        bytes.copy_within(2 * whole..kept + read, 0);
        kept = (kept + read) % 2;
    }
}

/// Pushes until all samples are taken; `some` pushes the samples from an index on.
fn push(
    stop: &AtomicBool,
    all: usize,
    mut some: impl FnMut(usize) -> Result<Pushed, SessionError>,
) -> Result<(), Failure> {
    let mut done = 0;
    while done < all && !stop.load(Ordering::SeqCst) {
        done += some(done).map_err(Failure::environment)?.taken;
        if done < all {
            std::thread::sleep(RETRY);
        }
    }
    Ok(())
}

/// Returns the session configured by the arguments, and its engine.
fn session(args: &Live, rate: usize, rules: Option<WordRules>) -> Result<(Engine, Session), Failure> {
    if args.generate.start_pose.is_some() {
        return Err(Failure::input("--start-pose does not go with `live`"));
    }
    let engine = model::engine(&args.engine, model::load(&args.engine.compute)?, 1)?;
    check_voice(args.voice, engine.model())?;
    let is_live = args.voice != Some(VoiceArg::Delayed) && engine.model().mouth().is_some();
    let voice = if is_live { Voice::Live } else { Voice::Delayed };
    let config = engine.model().config();
    let avatar = stream::avatar(&args.generate, config);
    let gestures = crate::gestures::known(&args.generate.gesture_clip, &config.skeleton)?;
    let layers = animate::layers(&args.generate);
    let words = rules.unwrap_or_default();
    let set = SessionConfig { avatar, layers, gestures, words, sample_rate: rate, voice, ..SessionConfig::new(config) };
    let made = engine.session(&set).map_err(Failure::input)?;
    if let Some(text) = &args.prompt {
        made.set_prompt(&animate::prompt(engine.model(), text)?).map_err(Failure::input)?;
    }
    for gesture in &args.generate.gesture {
        made.play_gesture(&gesture.name, &gesture.options).map_err(Failure::input)?;
    }
    Ok((engine, made))
}

/// Passes poses to `send`, `fps` a second, until the speech is over or `stop` is set; returns their number.
fn show(
    session: &Session,
    rate: usize,
    fps: f64,
    stop: &AtomicBool,
    ended: &mpsc::Receiver<Result<(), Failure>>,
    mut send: impl FnMut(Frame, f64) -> Result<(), Failure>,
) -> Result<u64, Failure> {
    let behind = session.latency().mouth_samples as f64 / rate as f64 + MARGIN;
    let (start, mut sent, mut is_spoken) = (Instant::now(), 0, false);
    while !stop.load(Ordering::SeqCst) {
        let now = start.elapsed().as_secs_f64();
        let mut result = Ok(());
        session
            .sample_pose((now - behind).max(0.0), |frame| result = send(frame, now))
            .map_err(Failure::environment)?;
        result?;
        sent += 1;
        match ended.try_recv() {
            Ok(read) => {
                read?;
                is_spoken = true;
            }
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => {}
        }
        if is_spoken && session.is_done().map_err(Failure::environment)? {
            break;
        }
        let due = Duration::from_secs_f64(sent as f64 / fps);
        std::thread::sleep(due.saturating_sub(start.elapsed()));
    }
    Ok(sent)
}

#[cfg(test)]
mod tests;
