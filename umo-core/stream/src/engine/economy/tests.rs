use super::*;

const PERIOD: Duration = Duration::from_millis(500);

/// Bytes of a CPU set of Windows.
fn set(id: u8, class: u8) -> Vec<u8> {
    let mut bytes = vec![0; 32];
    (bytes[0], bytes[8], bytes[15], bytes[18]) = (32, id, id, class);
    bytes
}

/// Four fast cores and eight slow ones.
fn machine() -> Cores {
    Cores::of_cpu_sets(&(0..12).flat_map(|id| set(id, u8::from(id < 4))).collect::<Vec<_>>())
}

fn plan(change: impl FnOnce(&mut EngineConfig)) -> (usize, Option<CoreKind>, Option<CoreKind>) {
    let mut config = EngineConfig { threads: Threads::Own(4), machine: Some(machine()), ..EngineConfig::default() };
    change(&mut config);
    let plan = Plan::new(&config);
    (plan.threads, plan.team.map(|group| group.kind), plan.slow.map(|group| group.kind))
}

#[test]
fn threads_of_a_team_are_of_one_kind_and_no_more_than_its_cores() {
    let (fast, slow) = (Some(CoreKind::Performance), Some(CoreKind::Efficiency));
    assert_eq!(plan(|_| ()), (4, fast, slow));
    // Eight slow cores are faster together than four fast ones; a slow core is then nothing that saves energy.
    assert_eq!(plan(|config| config.threads = Threads::Own(12)), (8, slow, None));
    assert_eq!(plan(|config| config.threads = Threads::Own(5)), (4, fast, slow));
    assert_eq!(plan(|config| config.threads = Threads::Own(1)), (1, fast, slow));
    assert_eq!(
        plan(|config| (config.threads, config.core_kinds) = (Threads::Own(12), CoreKinds::Performance)),
        (4, fast, None)
    );
    assert_eq!(plan(|config| config.core_kinds = CoreKinds::Efficiency), (4, slow, None));
    // Left to the system: as asked, by the cores that the host chose, on the host's threads, or on equal cores.
    let left = (4, None, None);
    assert_eq!(plan(|config| config.core_kinds = CoreKinds::System), left);
    assert_eq!(plan(|config| config.cores = vec![0]), left);
    assert_eq!(plan(|config| config.threads = Threads::Host(3)), left);
    assert_eq!(plan(|config| config.machine = Some(Cores::unknown())), left);
    // Who needs frames in time, or computes chunks together, does not save.
    assert_eq!(plan(|config| config.priority = Priority::High), (4, fast, None));
    assert_eq!(plan(|config| config.batch_window = PERIOD), (4, fast, None));
}

/// A speaking avatar: a chunk each half second.
struct Voice {
    economy: Economy,
    now: u64,
}

impl Voice {
    fn new() -> Self {
        Self { economy: Economy::new(1.0 / 0.6), now: 1 << 62 }
    }

    /// Computes `count` chunks that take these milliseconds on the team and on the slow core; returns how many were on
    /// the latter.
    fn speak(&mut self, count: usize, [team, slow]: [u64; 2]) -> usize {
        let one = |_: &usize| {
            let is_slow = self.economy.is_on();
            self.now += 500_000_000;
            let time = Duration::from_millis(if is_slow { slow } else { team });
            self.economy.learn(Took { is_slow, chunks: 1, time, period: PERIOD }, self.now);
            is_slow
        };
        (0..count).filter(one).count()
    }
}

#[test]
fn a_lone_voice_moves_to_the_slow_core_and_stays_while_that_has_room() {
    let mut voice = Voice::new();
    assert_eq!(voice.speak(4, [10, 20]), 0);
    assert_eq!(voice.speak(100, [10, 20]), 100);
    // One that takes most of the fast core never does.
    assert_eq!(Voice::new().speak(100, [150, 250]), 0);
}

#[test]
fn a_slow_core_that_others_use_is_left_and_tried_again_ever_less_often() {
    let mut voice = Voice::new();
    voice.speak(50, [10, 20]);
    // Another program comes.
    assert_eq!(voice.speak(1, [10, 300]), 1);
    assert!(!voice.economy.is_on());
    // 5 s, 10 s, 20 s, …: in five minutes a few chunks are late, not every other one.
    let tried = voice.speak(600, [10, 300]);
    assert!((2..=8).contains(&tried), "{tried}");
    // It goes.
    assert!(voice.speak(700, [10, 20]) > 0 && voice.economy.is_on());
    assert_eq!(voice.speak(200, [10, 20]), 200);
    // After that it may be wrong once without a long wait.
    voice.speak(1, [10, 300]);
    assert!(voice.speak(40, [10, 20]) > 20);
}

#[test]
fn a_crowd_is_never_the_slow_cores() {
    let mut voice = Voice::new();
    for _ in 0..100 {
        voice.now += 500_000_000;
        let took = Took { is_slow: false, chunks: 4, time: Duration::from_millis(30), period: PERIOD };
        voice.economy.learn(took, voice.now);
        assert!(!voice.economy.is_on());
    }
    // Many voices whose chunks fall due one by one fill the slow core: their sum counts.
    let mut voice = Voice::new();
    let mut slow = 0;
    for _ in 0..2000 {
        let is_slow = voice.economy.is_on();
        voice.now += 20_000_000;
        let time = Duration::from_millis(if is_slow { 20 } else { 10 });
        voice.economy.learn(Took { is_slow, chunks: 1, time, period: PERIOD }, voice.now);
        slow += usize::from(is_slow);
    }
    assert!(slow < 700, "{slow}");
}
