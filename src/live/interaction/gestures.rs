//! Gestures of a hand with a Wiimote: converts tracked poses and buttons to intents.
//!
//! Buttons and poses arrive separately ([`Gestures::hold`], [`Gestures::track`]): an outdated pose
//! may be dropped, its buttons may not. Late samples are recognised by their time and ignored.
//! Poses move a view only while B is held.
//!
//! A tracked hand at rest jitters by millimetres between reports. While A is held, the cursor
//! follows the hand's mean position and moves a fraction of its way
//! ([`HandOptions::precise_gain`]). The fraction reduces jitter by the same factor, and the user
//! steers by watching the cursor.

use glam::{DQuat, DVec3};

use super::hand::{HandOptions, HandSample};
use super::intent::{Intent, IntentError, PlacePhase, unit};
use relief_tracking::{Buttons, TrackingState};

/// Longest time that a held button counts for between two reports, ns: a connection that stands
/// still does not zoom.
const LONGEST_GAP_NS: u64 = 100_000_000;
/// A sample that is older than the newest by more than this, ns, comes from a clock that was reset.
const OTHER_CLOCK_NS: u64 = 2_000_000_000;
/// Farthest that a hand may be in view, mm.
const FARTHEST_MM: f64 = 1e5;

/// The hand in view: scaled, along view axes, mm from the focal point.
#[derive(Clone, Copy, Debug)]
struct HandInView {
    place: DVec3,
    orientation: DQuat,
}

/// The state of button B.
#[derive(Clone, Copy, Debug)]
enum TriggerState {
    Open,
    /// B is held; the next pose takes hold, for the first time or again.
    Closing,
    /// The volume is held but rests: the hand has not left the dead zone around this.
    Resting(HandInView),
    Moving,
}

/// Precise movement of the cursor: it starts where A was pressed and follows the movement of the
/// hand's mean since then.
#[derive(Clone, Copy, Debug)]
struct Precise {
    cursor: DVec3,
    mean: DVec3,
}

/// Makes intents from the poses and buttons of one hand.
#[derive(Clone, Debug)]
pub struct Gestures {
    options: HandOptions,
    view_from_beacon: DQuat,
    /// Buttons held.
    held: Buttons,
    /// Time of the newest buttons, of the newest pose, and up to which held buttons have counted.
    held_ns: Option<u64>,
    tracked_ns: Option<u64>,
    counted_ns: Option<u64>,
    /// Position of the tip in view axes that stands for the focal point.
    center: Option<DVec3>,
    /// The hand, while it is tracked.
    hand: Option<HandInView>,
    /// Mean of its positions, weighted towards the newest.
    mean: Option<DVec3>,
    precise: Option<Precise>,
    grip: TriggerState,
    /// Whether a grab was sent that no release has followed.
    grabbed: bool,
    /// Whether the last intent was a preview.
    placing: bool,
    /// Last position that was sent for the cursor.
    cursor: Option<DVec3>,
}

impl Gestures {
    /// No hand has been tracked yet.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(options: HandOptions) -> Result<Self, IntentError> {
        options.validate()?;
        let view_from_beacon = unit("view_from_beacon_xyzw", &options.view_from_beacon_xyzw)?;
        Ok(Self {
            options,
            view_from_beacon,
            held: Buttons::default(),
            held_ns: None,
            tracked_ns: None,
            counted_ns: None,
            center: None,
            hand: None,
            mean: None,
            precise: None,
            grip: TriggerState::Open,
            grabbed: false,
            placing: false,
            cursor: None,
        })
    }

    /// Changes the options. A held volume stays held and does not jump.
    ///
    /// # Errors
    /// When an option is out of range; nothing has changed then.
    pub fn configure(&mut self, options: HandOptions) -> Result<(), IntentError> {
        options.validate()?;
        self.view_from_beacon = unit("view_from_beacon_xyzw", &options.view_from_beacon_xyzw)?;
        self.options = options;
        self.recenter();
        Ok(())
    }

    /// The buttons that are held at this time. Those of every report count, also of one whose pose
    /// is dropped.
    pub fn hold(&mut self, t_ns: u64, buttons: Buttons) -> Vec<Intent> {
        let mut intents = Vec::new();
        match order(self.held_ns, t_ns) {
            ReportOrder::Late => return intents,
            ReportOrder::Restarted => intents = self.end(),
            ReportOrder::Newer | ReportOrder::Same => {}
        }
        self.count(t_ns, &mut intents);
        self.held_ns = Some(t_ns);
        let before = std::mem::replace(&mut self.held, buttons);
        let pressed = |button| buttons.contains(button) && !before.contains(button);
        let released = |button| before.contains(button) && !buttons.contains(button);
        if pressed(Buttons::B) {
            self.grip = TriggerState::Closing;
        }
        if released(Buttons::B) {
            self.let_go(&mut intents);
        }
        if pressed(Buttons::A)
            && let Some(hand) = self.hand
        {
            let mean = self.mean.unwrap_or(hand.place);
            let rests = mean.distance(hand.place) <= self.options.dead_zone_mm * self.options.gain;
            let cursor = if rests { mean } else { hand.place };
            self.precise = Some(Precise { cursor, mean });
            self.point(cursor, &mut intents);
            self.placing = true;
            intents.push(Intent::Place { phase: PlacePhase::Take });
        }
        if released(Buttons::A) {
            self.finish_placing(PlacePhase::Commit, &mut intents);
        }
        let step = |step| Intent::Preset { name: None, step: Some(step) };
        for (button, intent) in [
            (Buttons::LEFT, step(-1)),
            (Buttons::RIGHT, step(1)),
            (Buttons::ONE, Intent::Undo {}),
            (Buttons::TWO, Intent::NextLabel {}),
            (Buttons::HOME, Intent::Reset {}),
        ] {
            if pressed(button) {
                intents.push(intent);
            }
        }
        if pressed(Buttons::HOME) {
            self.recenter();
        }
        intents
    }

    /// The pose of the hand at this time. Samples that are not newer than the last are left out.
    pub fn track(&mut self, sample: &HandSample) -> Vec<Intent> {
        let mut intents = Vec::new();
        match order(self.tracked_ns, sample.t_ns) {
            ReportOrder::Late | ReportOrder::Same => return intents,
            ReportOrder::Restarted => intents = self.end(),
            ReportOrder::Newer => {}
        }
        self.count(sample.t_ns, &mut intents);
        let since = self.tracked_ns.replace(sample.t_ns).map_or(0, |then| sample.t_ns.saturating_sub(then));
        self.hand = self.seen(sample);
        self.mean = self.hand.map(|hand| self.mean_with(hand.place, since));
        match self.hand {
            Some(hand) => self.follow(hand, &mut intents),
            None => {
                self.finish_placing(PlacePhase::Cancel, &mut intents);
                self.loosen();
            }
        }
        intents
    }

    /// The hand is gone: nothing is held or placed any more.
    pub fn end(&mut self) -> Vec<Intent> {
        let mut intents = Vec::new();
        self.let_go(&mut intents);
        self.finish_placing(PlacePhase::Cancel, &mut intents);
        self.held = Buttons::default();
        (self.held_ns, self.tracked_ns, self.counted_ns) = (None, None, None);
        self.hand = None;
        intents
    }

    /// The hand in view; `None` when it is not tracked or too far away.
    fn seen(&mut self, sample: &HandSample) -> Option<HandInView> {
        let pose = sample.pose.filter(|_| sample.state == TrackingState::Tracking)?;
        let tip = self.view_from_beacon * pose.tip(self.options.tip_mm);
        let fixed = self.options.tip_center_mm.map(|at| self.view_from_beacon * DVec3::from_array(at));
        let center = *self.center.get_or_insert(fixed.unwrap_or(tip));
        let place = (tip - center) * self.options.gain;
        let orientation = (self.view_from_beacon * pose.orientation()).normalize();
        (place.abs().max_element() <= FARTHEST_MM).then_some(HandInView { place, orientation })
    }

    fn follow(&mut self, hand: HandInView, intents: &mut Vec<Intent>) {
        if let TriggerState::Resting(from) = self.grip
            && let Some(edge) = self.edge_between(from, hand)
        {
            // Taking hold again at the zone's edge, the volume does not jump by the zone's width.
            self.grab(edge, intents);
            self.grip = TriggerState::Moving;
        }
        match self.grip {
            TriggerState::Closing => {
                self.grab(hand, intents);
                self.grip = TriggerState::Resting(hand);
            }
            TriggerState::Moving => {
                let (position_mm, orientation_xyzw) = (hand.place.to_array(), hand.orientation.to_array());
                intents.push(Intent::Move { position_mm, orientation_xyzw });
                self.point(hand.place, intents); // after it: a held item stays under the cursor
                self.precise = self.precise.map(|_| Precise { cursor: hand.place, ..self.led_by(hand) });
            }
            TriggerState::Open | TriggerState::Resting(_) => {
                let (wanted, share) = match self.precise {
                    Some(Precise { cursor, mean }) => {
                        let led = self.led_by(hand).mean - mean;
                        (cursor + led * self.options.precise_gain, self.options.precise_gain)
                    }
                    None => (hand.place, 1.0),
                };
                let zone = self.options.cursor_rest_mm * self.options.gain * share;
                if !self.cursor.is_some_and(|at| at.distance(wanted) <= zone) {
                    self.point(wanted, intents);
                }
            }
        }
    }

    /// The place at which a hand has left the dead zone around `from` on its way to `to`, if it has.
    fn edge_between(&self, from: HandInView, to: HandInView) -> Option<HandInView> {
        let angle = from.orientation.angle_between(to.orientation).to_degrees();
        let way = from.place.distance(to.place) / self.options.gain;
        let share = |zone: f64, gone: f64| if gone > zone { zone / gone } else { 1.0 };
        let first = share(self.options.dead_zone_deg, angle).min(share(self.options.dead_zone_mm, way));
        let edge = HandInView {
            place: from.place.lerp(to.place, first),
            orientation: from.orientation.slerp(to.orientation, first).normalize(),
        };
        (first < 1.0).then_some(edge)
    }

    /// Takes hold of the point under the tip.
    fn grab(&mut self, hand: HandInView, intents: &mut Vec<Intent>) {
        self.point(hand.place, intents);
        self.grabbed = true;
        intents.push(Intent::Grab {
            position_mm: hand.place.to_array(),
            orientation_xyzw: hand.orientation.to_array(),
            mode: self.options.grab_mode,
            pivot: self.options.pivot,
        });
    }

    /// The mean with a newer place.
    fn mean_with(&self, place: DVec3, since_ns: u64) -> DVec3 {
        let share = -(-(since_ns as f64) * 1e-9 / self.options.steady_s).exp_m1();
        // Without its own time the mean is the newest place.
        self.mean.map_or(place, |mean| if share.is_nan() { place } else { mean.lerp(place, share) })
    }

    /// A cursor that is led from here.
    fn led_by(&self, hand: HandInView) -> Precise {
        Precise { cursor: hand.place, mean: self.mean.unwrap_or(hand.place) }
    }

    fn point(&mut self, place: DVec3, intents: &mut Vec<Intent>) {
        self.cursor = Some(place);
        intents.push(Intent::Cursor {
            at_px: None,
            at_view_mm: Some(place.to_array()),
            by_view_mm: None,
            point_mm: None,
        });
    }

    fn let_go(&mut self, intents: &mut Vec<Intent>) {
        self.grip = TriggerState::Open;
        if std::mem::take(&mut self.grabbed) {
            intents.push(Intent::Release {});
        }
    }

    fn finish_placing(&mut self, phase: PlacePhase, intents: &mut Vec<Intent>) {
        self.precise = None;
        if std::mem::take(&mut self.placing) {
            intents.push(Intent::Place { phase });
        }
    }

    /// The next pose takes hold again, if B is held.
    fn loosen(&mut self) {
        if !matches!(self.grip, TriggerState::Open) {
            self.grip = TriggerState::Closing;
        }
    }

    /// The next tip is the focal point, unless another place is.
    fn recenter(&mut self) {
        (self.center, self.cursor, self.mean, self.precise) = (None, None, None, None);
        self.loosen();
    }

    /// Counts the effect of held buttons since the last count.
    fn count(&mut self, t_ns: u64, intents: &mut Vec<Intent>) {
        let since = self.counted_ns.map_or(0, |then| t_ns.saturating_sub(then));
        self.counted_ns = Some(self.counted_ns.map_or(t_ns, |then| then.max(t_ns)));
        let seconds = since.min(LONGEST_GAP_NS) as f64 * 1e-9;
        if seconds == 0.0 {
            return;
        }
        let direction =
            |more, less| f64::from(self.held.contains(more)) - f64::from(self.held.contains(less));
        let closer = direction(Buttons::PLUS, Buttons::MINUS);
        if closer != 0.0 {
            intents.push(Intent::Zoom { factor: self.options.zoom_per_s.powf(closer * seconds) });
        }
        let deeper = direction(Buttons::UP, Buttons::DOWN);
        if deeper != 0.0 {
            let by_mm = Some(deeper * self.options.clip_mm_per_s * seconds);
            intents.push(Intent::Clip { by_mm, to_mm: None });
        }
    }
}

enum ReportOrder {
    Newer,
    Same,
    Late,
    Restarted,
}

fn order(newest_ns: Option<u64>, t_ns: u64) -> ReportOrder {
    let Some(newest_ns) = newest_ns else { return ReportOrder::Newer };
    match newest_ns.checked_sub(t_ns) {
        None => ReportOrder::Newer,
        Some(0) => ReportOrder::Same,
        Some(behind) if behind <= OTHER_CLOCK_NS => ReportOrder::Late,
        Some(_) => ReportOrder::Restarted,
    }
}
