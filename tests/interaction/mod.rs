//! From hands to views, from outside: the effects of intents on a view, and the gestures of a
//! Wiimote, against closed forms.
#![expect(clippy::unwrap_used, reason = "a test may panic, in its helpers too")]

mod any;
mod hands;
mod recorded;
mod views;
mod wiimote;

use glam::{DQuat, DVec3};
use relief_base::{Patient, Point};
use relief_live::{AppliedIntent, Home, Intent, Stage, ViewState};
use relief_volume::{Camera, Orbit};

const SIZE_PX: [u32; 2] = [960, 540];
const RADIUS_MM: f64 = 150.0;

fn stage() -> Stage {
    stage_of(SIZE_PX, Home::ORBIT)
}

fn stage_of(size_px: [u32; 2], orbit: Orbit) -> Stage {
    let presets = ["bone", "skin", "lung"].map(str::to_owned).to_vec();
    let home = Home { orbit, preset: Some("bone".to_owned()) };
    Stage::new(center(), RADIUS_MM, size_px, presets, home).unwrap()
}

fn center() -> Point<Patient> {
    Point::new(10.0, -20.0, 300.0)
}

/// Intents one after another, so far apart that each is a step of its own.
struct Session {
    stage: Stage,
    state: ViewState,
    t_ns: u64,
}

impl Session {
    fn new() -> Self {
        Self::on(stage())
    }

    fn on(stage: Stage) -> Self {
        let state = ViewState::home(&stage);
        Self { stage, state, t_ns: 0 }
    }

    fn apply(&mut self, intent: &Intent) -> AppliedIntent {
        self.t_ns += 2_000_000_000;
        self.state.apply(&self.stage, self.t_ns, intent, None).unwrap()
    }

    fn json(&mut self, json: &str) -> AppliedIntent {
        self.apply(&Intent::from_json(json.as_bytes()).unwrap())
    }

    fn camera(&self) -> Camera {
        self.state.camera(&self.stage).unwrap()
    }

    /// Along view axes from the focal point, mm.
    fn in_view(&self, point: Point<Patient>) -> DVec3 {
        in_view(&self.camera(), point)
    }
}

fn in_view(camera: &Camera, point: Point<Patient>) -> DVec3 {
    (camera.view_from_patient() * point).xyz - (camera.view_from_patient() * camera.look_at()).xyz
}

fn grab(position: DVec3, orientation: DQuat) -> Intent {
    let (position_mm, orientation_xyzw) = (position.to_array(), orientation.to_array());
    Intent::Grab { position_mm, orientation_xyzw, mode: Default::default(), pivot: Default::default() }
}

fn movement(position: DVec3, orientation: DQuat) -> Intent {
    Intent::Move { position_mm: position.to_array(), orientation_xyzw: orientation.to_array() }
}

/// Patient points spread over the volume.
fn points() -> Vec<Point<Patient>> {
    let arms = [[0.0, 0.0, 0.0], [60.0, -30.0, 40.0], [-80.0, 20.0, 10.0], [5.0, 90.0, -70.0]];
    arms.map(|arm| Point::from_xyz(center().xyz + DVec3::from_array(arm))).to_vec()
}

fn assert_near(found: DVec3, wanted: DVec3, tolerance: f64, what: &str) {
    assert!((found - wanted).length() <= tolerance, "{what}: found {found}, wanted {wanted}");
}

fn assert_same_view(found: &Camera, wanted: &Camera, tolerance: f64, what: &str) {
    assert_near(found.eye().xyz, wanted.eye().xyz, tolerance * 1000.0, what);
    assert_near(found.look_at().xyz, wanted.look_at().xyz, tolerance * 1000.0, what);
    assert_near(found.up().xyz.normalize(), wanted.up().xyz.normalize(), tolerance, what);
    let extent = |camera: &Camera| camera.half_extent(SIZE_PX)[1];
    assert!((extent(found) / extent(wanted) - 1.0).abs() <= tolerance, "{what}: the projection differs");
}
