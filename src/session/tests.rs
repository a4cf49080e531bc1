//! The render service with a backend that counts, waits at a gate, refuses or panics on demand.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use super::*;
use relief_base::DepthLimits;
use relief_render::{Mode, SceneFile, Timings};
use relief_volume::{Grid, Orbit};

/// The progress of a picture that can be continued after every second band.
fn progress(bands: u64) -> Progress {
    Progress { bands, passes: 0, continued: 0, is_kept: bands.is_multiple_of(2) }
}

/// Renders 1x1 pictures. Each waits for a signal of the test, unless it is cancelled, and reports
/// its number.
struct Gated {
    go: Receiver<()>,
    started: SyncSender<f64>,
    forgotten: SyncSender<ContentHash>,
}

impl RenderBackend for Gated {
    fn render(
        &mut self,
        _: &Volume,
        request: &RenderRequest,
        goes_on: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError> {
        let _ = self.started.try_send(request.sample_distance_mm);
        for bands in 1.. {
            match self.go.recv_timeout(Duration::from_millis(1)) {
                Ok(()) => break,
                Err(RecvTimeoutError::Timeout) if goes_on(progress(bands)).is_break() => {
                    return Err(BackendError::Cancelled);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(gone) => return Err(BackendError::Failed(gone.into())),
            }
        }
        match request.sample_distance_mm {
            13.0 => panic!("unlucky"),
            14.0 => Err(BackendError::Refused("too large".into())),
            15.0 => Err(BackendError::Failed("lost".into())),
            _ => Ok(RenderedFrame {
                size_px: [1, 1],
                color_rgba: vec![[1; 4]],
                depth_mm: vec![5.0],
                display_mm: None,
                back: None,
                camera: request.camera,
                limits: DepthLimits::new(1.0, 9.0).expect("1 < 9"),
                nearest_ball_mm: None,
                is_partial: false,
                timings: Timings::default(),
            }),
        }
    }

    fn forget(&mut self, volume: ContentHash) {
        let _ = self.forgotten.try_send(volume);
    }
}

struct Bench {
    service: RenderService,
    go: SyncSender<()>,
    started: Receiver<f64>,
    forgotten: Receiver<ContentHash>,
    volume: Volume,
}

impl Bench {
    fn new(capacity: usize) -> Self {
        let ((go, gate), (starting, started)) = (sync_channel(64), sync_channel(64));
        let config = QueueConfig { capacity, ..QueueConfig::default() };
        let (forgetting, forgotten) = sync_channel(64);
        let backend = Gated { go: gate, started: starting, forgotten: forgetting };
        let service = RenderService::start(backend, config).unwrap();
        let grid = Grid::axis_aligned([2; 3], [1.0; 3], [0.0; 3]).unwrap();
        Self { service, go, started, forgotten, volume: Volume::new(grid, vec![0; 8]).unwrap() }
    }

    /// A request that its sample distance identifies.
    fn order(&self, mark: f64) -> Result<Ticket, ServiceError> {
        let mut scene = SceneFile::default().resolve(self.volume.grid(), &Orbit::default()).unwrap();
        scene.request.sample_distance_mm = mark;
        self.service.render(&self.volume, scene.request)
    }
}

impl Bench {
    /// A picture of many pixels that its sample distance identifies.
    fn large(&self, mark: f64, mode: Mode) -> Ticket {
        let file = SceneFile::default().with_size([4096, 4096]);
        let mut scene = file.resolve(self.volume.grid(), &Orbit::default()).unwrap();
        (scene.request.sample_distance_mm, scene.request.mode) = (mark, mode);
        self.service.render(&self.volume, scene.request).unwrap()
    }
}

/// Invariant: Small pictures go before large ones, and each large one is rendered in the end.
#[test]
fn small_pictures_go_before_large_ones_that_wait() {
    let bench = Bench::new(8);
    let first = bench.order(1.0).unwrap();
    bench.started.recv().unwrap();
    let large = [2.0, 3.0].map(|mark| bench.large(mark, Mode::Composite));
    let small = [4.0, 5.0].map(|mark| bench.order(mark).unwrap());
    for _ in 0..5 {
        bench.go.send(()).unwrap();
    }
    for ticket in [first].into_iter().chain(large).chain(small) {
        ticket.wait().unwrap();
    }
    // The mark is the distance of samples: longer steps are less work.
    assert_eq!(bench.started.try_iter().collect::<Vec<_>>(), [5.0, 4.0, 3.0, 2.0]);
}

/// Invariant: A large picture makes room for a much smaller one where nothing of it is lost, and
/// goes on.
#[test]
fn a_large_picture_makes_room_between_bands_and_goes_on() {
    let bench = Bench::new(8);
    let large = bench.large(1.0, Mode::Composite);
    assert_eq!(bench.started.recv().unwrap(), 1.0);
    let small = bench.order(2.0).unwrap();
    assert_eq!(bench.started.recv().unwrap(), 2.0, "between two bands");
    bench.go.send(()).unwrap();
    small.wait().unwrap();
    assert_eq!(bench.started.recv().unwrap(), 1.0, "it goes on");
    bench.go.send(()).unwrap();
    assert_eq!(large.wait().unwrap().origin, Origin::Rendered);
    let counts = bench.service.counts();
    assert_eq!((counts.skipped, counts.cancelled), (0, 0));
    assert_eq!(bench.service.waiting(), 0);
}

/// Fails until it is recreated, which takes some attempts.
struct Fragile {
    broken: bool,
    attempts: SyncSender<()>,
    failing: u32,
}

impl RenderBackend for Fragile {
    fn render(
        &mut self,
        _: &Volume,
        request: &RenderRequest,
        _: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<RenderedFrame, BackendError> {
        // Pictures of this distance lose the device.
        self.broken |= request.sample_distance_mm == 15.0;
        if self.broken {
            return Err(BackendError::Failed("lost".into()));
        }
        Ok(RenderedFrame {
            size_px: [1, 1],
            color_rgba: vec![[1; 4]],
            depth_mm: vec![5.0],
            display_mm: None,
            back: None,
            camera: request.camera,
            limits: DepthLimits::new(1.0, 9.0).expect("1 < 9"),
            nearest_ball_mm: None,
            is_partial: false,
            timings: Timings::default(),
        })
    }

    fn can_be_renewed(&self) -> bool {
        true
    }

    fn renew(&mut self) -> Result<(), BackendError> {
        let _ = self.attempts.try_send(());
        if self.failing > 0 {
            self.failing -= 1;
            return Err(BackendError::Failed("still lost".into()));
        }
        self.broken = false;
        Ok(())
    }
}

/// Invariant: A lost device is opened again, and the request that met the loss is tried once more.
#[test]
fn a_lost_device_is_opened_again_without_a_request() {
    for failing in [0, 3] {
        let (attempts, seen) = sync_channel(64);
        let backend = Fragile { broken: true, attempts, failing };
        let service = RenderService::start(backend, QueueConfig::default()).unwrap();
        let grid = Grid::axis_aligned([2; 3], [1.0; 3], [0.0; 3]).unwrap();
        let volume = Volume::new(grid, vec![0; 8]).unwrap();
        let scene = SceneFile::default().resolve(volume.grid(), &Orbit::default()).unwrap();
        let outcome = service.render(&volume, scene.request.clone()).unwrap().wait();
        assert_eq!(outcome.is_ok(), failing == 0, "{failing} attempts fail");
        for _ in 0..=failing {
            seen.recv_timeout(Duration::from_secs(60)).unwrap();
        }
        while !service.is_healthy() {
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(service.render(&volume, scene.request.clone()).unwrap().wait().is_ok());
        // A request that loses the device each time is tried twice, and no more.
        let losing = RenderRequest { sample_distance_mm: 15.0, ..scene.request };
        let outcome = service.render(&volume, losing).unwrap().wait();
        assert!(matches!(outcome, Err(ServiceError::Backend(BackendError::Failed(_)))));
    }
}

#[test]
fn a_full_queue_refuses_at_once_and_recovers() {
    let bench = Bench::new(2);
    let first = bench.order(1.0).unwrap();
    assert_eq!(bench.started.recv().unwrap(), 1.0);
    let rest = [bench.order(2.0).unwrap(), bench.order(3.0).unwrap()];
    assert_eq!(bench.service.waiting(), 2);
    assert!(matches!(bench.order(4.0), Err(ServiceError::Busy(2))));
    for _ in 0..3 {
        bench.go.send(()).unwrap();
    }
    for ticket in [first].into_iter().chain(rest) {
        assert_eq!(ticket.wait().unwrap().origin, Origin::Rendered);
    }
    assert_eq!(bench.service.waiting(), 0);
}

#[test]
fn an_abandoned_order_is_skipped() {
    let bench = Bench::new(4);
    let first = bench.order(1.0).unwrap();
    bench.started.recv().unwrap();
    drop(bench.order(2.0).unwrap());
    let last = bench.order(3.0).unwrap();
    bench.go.send(()).unwrap();
    bench.go.send(()).unwrap();
    first.wait().unwrap();
    last.wait().unwrap();
    assert_eq!(bench.started.try_iter().collect::<Vec<_>>(), [3.0]);
}

#[test]
fn an_order_whose_ticket_is_dropped_while_it_renders_makes_way_for_the_next() {
    let bench = Bench::new(4);
    let first = bench.order(1.0).unwrap();
    bench.started.recv().unwrap();
    let second = bench.order(2.0).unwrap();
    assert!(bench.started.try_recv().is_err(), "the first one renders");
    drop(first);
    assert_eq!(bench.started.recv().unwrap(), 2.0, "without a word that the first may finish");
    bench.go.send(()).unwrap();
    assert_eq!(second.wait().unwrap().origin, Origin::Rendered);
    let counts = bench.service.counts();
    assert_eq!((counts.skipped, counts.cancelled), (0, 1));
    assert!(counts.bands > 0, "{counts:?}");
    assert!(bench.service.is_healthy());
}

#[test]
fn equal_orders_share_one_render_even_while_they_wait() {
    let bench = Bench::new(4);
    let [a, b] = [bench.order(1.0).unwrap(), bench.order(1.0).unwrap()];
    bench.go.send(()).unwrap();
    let (a, b) = (a.wait().unwrap(), b.wait().unwrap());
    assert_eq!((a.origin, b.origin), (Origin::Rendered, Origin::Reused));
    assert!(Arc::ptr_eq(&a.frame, &b.frame));
    assert_eq!(bench.order(1.0).unwrap().wait().unwrap().origin, Origin::Reused);
    assert_eq!(bench.started.try_iter().count(), 1);
}

#[test]
fn a_panic_or_a_refusal_ends_one_order_alone() {
    let bench = Bench::new(4);
    let orders = [13.0, 14.0, 1.0].map(|mark| bench.order(mark).unwrap());
    for _ in 0..3 {
        bench.go.send(()).unwrap();
    }
    let [panicked, refused, fine] = orders.map(Ticket::wait);
    assert!(matches!(panicked, Err(ServiceError::Panicked(text)) if text == "unlucky"));
    assert!(matches!(refused, Err(ServiceError::Backend(BackendError::Refused(_)))));
    assert_eq!(fine.unwrap().frame.depth_mm, [5.0]);
    assert!(bench.service.is_alive());
}

#[test]
fn shutting_down_answers_what_waits_and_refuses_more() {
    let bench = Bench::new(4);
    let orders = [1.0, 2.0].map(|mark| bench.order(mark).unwrap());
    for _ in 0..2 {
        bench.go.send(()).unwrap();
    }
    bench.service.shut_down();
    assert!(orders.into_iter().all(|order| order.wait().is_ok()));
    assert!(matches!(bench.order(3.0), Err(ServiceError::Stopped)));
    assert!(!bench.service.is_alive());
    bench.service.shut_down();
}

#[test]
fn a_forgotten_volume_leaves_no_frame_even_of_orders_that_wait() {
    let bench = Bench::new(2);
    let hash = bench.volume.content_hash();
    bench.go.send(()).unwrap();
    bench.order(1.0).unwrap().wait().unwrap();
    let tickets = [2.0, 3.0].map(|mark| bench.order(mark).unwrap());
    bench.service.forget(hash); // the queue may be full by now
    assert!(bench.forgotten.try_recv().is_err(), "a render is running");
    for _ in 0..3 {
        bench.go.send(()).unwrap();
    }
    for ticket in tickets {
        ticket.wait().unwrap();
    }
    assert_eq!(bench.forgotten.recv().unwrap(), hash);
    assert_eq!(bench.order(3.0).unwrap().wait().unwrap().origin, Origin::Rendered);
}

#[test]
fn a_backend_that_failed_is_unhealthy_until_it_renders() {
    let bench = Bench::new(4);
    for (mark, is_healthy) in [(14.0, true), (15.0, false), (14.0, false), (13.0, false), (1.0, true)] {
        bench.go.send(()).unwrap();
        let _ = bench.order(mark).unwrap().wait();
        assert_eq!(bench.service.is_healthy(), is_healthy, "{mark}");
    }
}
