//! Every piece runs exactly once on any set of threads; panics and late threads have no other effect.

use super::*;

#[test]
fn a_core_that_does_not_exist_is_named_with_those_that_do() {
    for (caller, cores, asked) in [(Some(9999), &[][..], "cores 9999:"), (None, &[9998, 9999], "cores 9998, 9999:")] {
        let Err(error) = Team::placed(3, Placement { caller, cores, ..Placement::default() }) else {
            panic!("there is no such core")
        };
        let error = error.to_string();
        assert!(error.starts_with(asked), "{error}");
        assert!(!error.contains("Some") && !error.contains("None"), "{error}");
    }
}

#[test]
fn every_piece_is_visited_once_on_any_thread_count() {
    for threads in [1, 2, 3, 8] {
        let team = Team::new(threads).unwrap();
        for cols in [0, 1, 15, 16, 17, 100, 333, 1000] {
            let mut data = vec![0_u32; 3 * cols];
            for round in 0..50 {
                let y = MatMut::new(&mut data, 3, cols).unwrap();
                let work = if round % 2 == 0 { PARALLEL_THRESHOLD } else { DYNAMIC_THRESHOLD };
                team.columns(y, 16, work, |range, mut y| {
                    assert_eq!(range.len(), y.cols());
                    assert!(range.start.is_multiple_of(16) && (range.end.is_multiple_of(16) || range.end == cols));
                    for row in 0..3 {
                        y.row_mut(row).iter_mut().for_each(|v| *v += 1);
                    }
                    Ok(())
                })
                .unwrap();
                assert!(data.iter().all(|&v| v == round + 1));
            }
        }
    }
}

#[test]
fn every_piece_is_visited_once_for_any_shares() {
    for threads in [2, 3, 8] {
        let team = Team::new(threads).unwrap();
        for (i, share) in team.shares.iter().enumerate() {
            share.store((0.3 + i as f32).to_bits(), Ordering::Relaxed);
        }
        for cols in [17, 100, 333] {
            let mut data = vec![0_u32; 3 * cols];
            let y = MatMut::new(&mut data, 3, cols).unwrap();
            team.columns(y, 16, usize::MAX, |_, mut y| {
                (0..3).for_each(|row| y.row_mut(row).iter_mut().for_each(|v| *v += 1));
                Ok(())
            })
            .unwrap();
            assert!(data.iter().all(|&v| v == 1));
        }
    }
}

#[test]
fn dynamic_pieces_go_to_idle_threads() {
    let team = Team::new(2).unwrap();
    let (mut data, others) = ([0_u32; 96], AtomicU32::new(0));
    let y = MatMut::new(&mut data, 1, 96).unwrap();
    team.columns(y, 1, DYNAMIC_THRESHOLD, |range, _| {
        if range.start > 0 {
            others.fetch_add(1, Ordering::Relaxed);
            return Ok(());
        }
        // The first piece runs until all others are done, so they go to the other thread.
        let start = Instant::now();
        while others.load(Ordering::Relaxed) < 5 {
            assert!(start.elapsed() < Duration::from_secs(60), "pieces wait for this thread");
            std::thread::yield_now();
        }
        Ok(())
    })
    .unwrap();
}

#[test]
fn prefetch_hints_are_split_like_the_job() {
    let data = [0_u8; 4096];
    for threads in [1, 2, 3] {
        let team = Team::new(threads).unwrap();
        let work = PARALLEL_THRESHOLD;
        let (expected, seen) = (std::sync::Mutex::new(vec![]), std::sync::Mutex::new(vec![]));
        team.prefetch_next(100, 16, |range| {
            expected.lock().unwrap().push(range);
            PrefetchHint::new(&data, &data)
        });
        for _ in 0..3 {
            seen.lock().unwrap().clear();
            let mut data = [0_u32; 100];
            let y = MatMut::new(&mut data, 1, 100).unwrap();
            team.columns(y, 16, work, |range, _| {
                seen.lock().unwrap().push(range);
                Ok(())
            })
            .unwrap();
        }
        let (expected, mut seen) = (expected.into_inner().unwrap(), seen.into_inner().unwrap());
        seen.sort_by_key(|range| range.start);
        assert_eq!(expected, if threads > 1 { seen } else { vec![] });
    }
}

#[test]
fn errors_of_pieces_are_returned() {
    let team = Team::new(4).unwrap();
    let mut data = vec![0.0_f32; 4];
    let y = MatMut::new(&mut data, 4, 1).unwrap();
    let result =
        team.rows(y, usize::MAX, |range, _| if range.contains(&2) { Err(StepError::Empty("two")) } else { Ok(()) });
    assert_eq!(result, Err(StepError::Empty("two")));
}

#[test]
fn a_sleeping_team_wakes_up() {
    let team = Team::new(2).unwrap();
    let count = AtomicU32::new(0);
    for _ in 0..20 {
        std::thread::sleep(std::time::Duration::from_millis(5));
        team.run(&|_| {
            count.fetch_add(1, Ordering::Relaxed);
        });
    }
    assert_eq!(count.load(Ordering::Relaxed), 40);
}

#[test]
fn a_worker_that_does_not_come_delays_nobody() {
    // Without workers, as if none of them had a core.
    let team = Team::bare(4, false);
    let done: Vec<AtomicU32> = (0..4).map(|_| AtomicU32::new(0)).collect();
    for round in 1..=3 {
        team.run(&|index| {
            done[index].fetch_add(1, Ordering::Relaxed);
        });
        assert!(done.iter().all(|count| count.load(Ordering::Relaxed) == round));
    }
}

#[test]
fn external_workers_that_join_and_leave_change_nothing() {
    let team = Team::with_external_workers(4);
    let done: Vec<AtomicU32> = (0..4).map(|_| AtomicU32::new(0)).collect();
    let stop = AtomicBool::new(false);
    let by_external = AtomicU32::new(0);
    std::thread::scope(|scope| {
        let caller = std::thread::current().id();
        for _ in 0..3 {
            let external_workers = team.external_workers();
            scope.spawn(|| {
                let external_workers = external_workers;
                while !stop.load(Ordering::Relaxed) {
                    external_workers.work();
                    std::thread::yield_now();
                }
            });
        }
        for round in 0..2_000 {
            // Some jobs have only the caller.
            let joining = (round % 5 > 0).then(|| team.admit());
            for _ in 0..5 {
                team.run(&|index| {
                    done[index].fetch_add(1, Ordering::Relaxed);
                    by_external.fetch_add(u32::from(std::thread::current().id() != caller), Ordering::Relaxed);
                    (0..200).for_each(|_| std::hint::spin_loop());
                });
                let first = done[0].load(Ordering::Relaxed);
                assert!(done.iter().all(|count| count.load(Ordering::Relaxed) == first));
            }
            drop(joining);
        }
        stop.store(true, Ordering::Relaxed);
    });
    assert_eq!(done[0].load(Ordering::Relaxed), 10_000);
    assert!(by_external.load(Ordering::Relaxed) > 0);
}

#[test]
fn a_panic_in_a_worker_reaches_the_caller_and_the_team_lives_on() {
    let team = Team::new(2).unwrap();
    let defect = contain(|| team.run(&|i| assert!(i == 0, "planned"))).unwrap_err();
    assert_eq!(defect.message(), "planned");
    let count = AtomicU32::new(0);
    team.run(&|_| {
        count.fetch_add(1, Ordering::Relaxed);
    });
    assert_eq!(count.load(Ordering::Relaxed), 2);
}

#[cfg(all(feature = "threads", any(target_os = "linux", windows)))]
#[test]
fn an_error_about_cores_names_the_wrong_ones_and_all_that_there_are() {
    // In its own thread, which stays bound.
    let refused = || {
        let usable = cores::usable();
        let placement = Placement { caller: Some(usable[0]), cores: &[8_000], ..Placement::default() };
        let error = Team::placed(2, placement).unwrap_err().to_string();
        let usable: Vec<_> = usable.iter().map(ToString::to_string).collect();
        let usable = usable.join(", ");
        assert_eq!(error, format!("cores 8000: no thread can be bound to them; this process may use cores {usable}"));
    };
    std::thread::spawn(refused).join().unwrap();
}
