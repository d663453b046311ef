//! All audio arrives, and poses come until the speech ends.

use std::collections::VecDeque;

use super::*;

/// A reader that returns a few bytes at a time.
struct Trickle(VecDeque<u8>, usize);

impl Read for Trickle {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.1.min(bytes.len()).min(self.0.len());
        for byte in &mut bytes[..count] {
            *byte = self.0.pop_front().expect("counted");
        }
        Ok(count)
    }
}

fn args(extra: &[&str]) -> Live {
    use clap::Parser as _;
    let words = ["umo", "live", "--vmc", "127.0.0.1:39539", "--threads", "1"].iter().chain(extra);
    match crate::args::Args::try_parse_from(words).expect("arguments").command {
        crate::args::Command::Live(args) => args,
        _ => unreachable!("live was asked for"),
    }
}

#[test]
fn samples_are_whole_however_their_bytes_come() {
    let (_engine, session) = session(&args(&["--voice", "delayed"]), 16_000, None).expect("a session");
    let bytes: VecDeque<u8> = (0..9_601_u32).map(|i| (i % 251) as u8).collect();
    hear(&session, &mut Trickle(bytes, 7), &AtomicBool::new(false)).expect("heard");
    session.finish().expect("finished");
    let mut frames = 0;
    while !session.is_done().expect("runs") {
        frames += session.pull_frames(usize::MAX, |_| {}).expect("frames");
        std::thread::sleep(RETRY);
    }
    // 4,800 samples, and half a sample whose other byte never came.
    assert_eq!(frames, 9);
}

#[test]
fn poses_are_shown_until_the_speech_is_over() {
    let (_engine, session) = session(&args(&["--voice", "delayed"]), 16_000, None).expect("a session");
    let (tell, ended) = channel();
    session.push_audio(&[0.1; 8_000]).expect("pushed");
    session.finish().expect("finished");
    tell.send(Ok(())).expect("told");
    let mut times = Vec::new();
    let stop = AtomicBool::new(false);
    let sent = show(&session, 16_000, 120.0, &stop, &ended, |frame, seconds| {
        times.push(seconds);
        assert_eq!(frame.face.len(), 52);
        Ok(())
    })
    .expect("shown");
    assert_eq!(sent, times.len() as u64);
    assert!(times.is_sorted());
    // The last frame is at 0.47 s of speech.
    assert!(*times.last().expect("poses") > 0.4);
}

#[test]
fn what_the_reader_fails_with_ends_it() {
    let (_engine, session) = session(&args(&[]), 16_000, None).expect("a session");
    let (tell, ended) = channel();
    tell.send(Err(Failure::environment("gone"))).expect("told");
    let shown = show(&session, 16_000, 60.0, &AtomicBool::new(false), &ended, |_, _| Ok(()));
    assert_eq!(shown, Err(Failure::environment("gone")));
}

#[test]
fn addresses_and_rates_are_checked() {
    assert!(resolve("--vmc", "127.0.0.1:39539").is_ok());
    for wrong in ["127.0.0.1", "nowhere.invalid:1", ":", "127.0.0.1:99999"] {
        let Err(Failure::Input(said)) = resolve("--livelink", wrong) else { panic!("{wrong}") };
        assert!(said.starts_with("--livelink") && said.contains("HOST:PORT"));
    }
    assert!(Source::open(&args(&["--rate", "1"])).is_err());
    assert!(Source::open(&args(&["--rate", "16000", "speech.wav"])).is_err());
}
