//! A session of `relief client` with its connection.

use anyhow::{Context, bail};

use crate::client::arguments::{ClientArguments, Part};
use crate::panel::panel_for;
use crate::quilt;
use relief_client::{Access, Composer, Options};
use relief_display::{DisplaySettings, Layout, ProfileName, ProfileSetting, USUAL_VIEW_CONE_DEG};
use relief_live::{Accept, ColorFormat, Hello, LiveLayout, Role, Settings, ViewsOutput};
use relief_render::{AdapterChoice, view_synthesizer};

/// The session that the arguments describe.
pub(crate) struct Session {
    pub(crate) options: Options,
    pub(crate) composer: Composer,
    #[cfg(feature = "window")]
    pub(crate) layout: Layout,
    /// Size of the display's frame, pixels.
    #[cfg(feature = "window")]
    pub(crate) frame_px: [u32; 2],
}

impl Session {
    pub(crate) fn of(arguments: &ClientArguments) -> anyhow::Result<Self> {
        let usual = DisplaySettings::default();
        let output = views_output(arguments)?;
        let display = display_of(arguments, output.as_ref())?;
        let role = if arguments.role == Part::Watcher { Role::Watcher } else { Role::Presenter };
        let settings = Settings {
            display: (display != usual).then(|| display.clone()),
            preset: arguments.preset.clone(),
            annotations: arguments.annotations.clone(),
            ..Settings::default()
        };
        let settings = (settings != Settings::default()).then_some(settings);
        if role == Role::Watcher && (settings.is_some() || arguments.look.is_some()) {
            bail!(
                "a watcher sees what presenters show: leave --preset, --look, --layout, --profile, --factor, --offset, --screen-plane and --annotations out"
            );
        }
        if role == Role::Watcher && arguments.remote.is_there() {
            bail!("a watcher moves nothing: leave --wiimote out");
        }
        let mut accept = Accept::default();
        if arguments.lossless {
            accept.color = vec![ColorFormat::RgbZstd.name().to_owned()];
        }
        let hello = Hello {
            client: Some(format!("relief-client {}", env!("CARGO_PKG_VERSION"))),
            author: arguments.author.clone(),
            volume: arguments.volume.clone(),
            view: arguments.view.clone(),
            role,
            accept,
            size_px: arguments.size,
            resume: None,
            settings,
        };
        // The display settings of others of a shared view are not known here.
        let is_own = role == Role::Presenter && (arguments.view.is_none() || display != usual);
        let asked = is_own.then(|| display.header());
        let profile = display.profile()?;
        #[cfg(feature = "window")]
        let frame_px = profile.frame_px();
        let mut composer = Composer::new(profile, asked);
        if let Some(output) = output {
            let choice = AdapterChoice::parse(arguments.views.adapter.as_deref().unwrap_or_default());
            let maker = view_synthesizer(&choice).context("views cannot be made")?;
            composer = composer.with_views(output, maker);
        }
        if let Some(distance_mm) = arguments.eyes.distance_mm()? {
            composer = composer.with_distance_mm(distance_mm);
        }
        let server = arguments.server.clone();
        let access = Access::new(&server, arguments.token.clone(), arguments.ca.as_deref())?;
        if arguments.token.is_some() && !server.is_encrypted() && !arguments.is_local() {
            eprintln!(
                "warning: the token crosses the network unencrypted; use https:// if the server has it"
            );
        }
        let options = Options { server, access, hello, wait: arguments.waits() };
        Ok(Self {
            options,
            composer,
            #[cfg(feature = "window")]
            layout: output.map_or(display.layout, |output| output.layout),
            #[cfg(feature = "window")]
            frame_px,
        })
    }
}

/// The views that the client makes itself, if its layout has views.
fn views_output(arguments: &ClientArguments) -> anyhow::Result<Option<ViewsOutput>> {
    let views = &arguments.views;
    let mut layout = arguments.layout;
    for file in [&arguments.headless.save_frame, &arguments.recording.record].into_iter().flatten() {
        layout = quilt::layout_of(file, layout)?;
        if let Some(size_px) = arguments.size {
            quilt::check_aspect(file, size_px)?;
        }
    }
    let Some(layout) = layout.filter(|layout| layout.view_count() > 0) else {
        if views.is_given() {
            bail!(
                "--panel, --view-span, --view-cone, --layers and --adapter are for layouts of views, such as stereo or views-9"
            );
        }
        return Ok(None);
    };
    if layout == Layout::Wiggle {
        bail!("layout wiggle is an animation of a still picture; relief render and relief preview write it");
    }
    let panel = views.panel.as_deref().map(|path| panel_for(layout, path)).transpose()?;
    let panel = panel.unwrap_or_default();
    let outputs = [&arguments.headless.save_frame, &arguments.recording.record];
    let is_quilt = outputs.into_iter().flatten().any(|path| quilt::is_named(path));
    let usual_cone = (is_quilt && views.view_span.is_none()).then_some(USUAL_VIEW_CONE_DEG);
    let (view_span, view_cone_deg) = (views.view_span, views.view_cone.or(usual_cone));
    DisplaySettings { view_span, view_cone_deg, ..DisplaySettings::default() }.validate()?;
    Ok(Some(ViewsOutput { layout, panel, view_span, view_cone_deg, tracked_eyes: None }))
}

/// The layout in which the server sends what views are made of.
fn streamed(layers: Option<u8>) -> Layout {
    if layers == Some(2) { Layout::Declipse } else { Layout::Rgbd }
}

/// The display that the arguments name.
fn display_of(arguments: &ClientArguments, output: Option<&ViewsOutput>) -> anyhow::Result<DisplaySettings> {
    let usual = DisplaySettings::default();
    let of_profile = match arguments.profile {
        Some(ProfileName::Dimenco4k) => Layout::Wowvx4k,
        _ => usual.layout,
    };
    let display = DisplaySettings {
        layout: match output {
            Some(_) => streamed(arguments.views.layers),
            None => arguments.layout.unwrap_or(of_profile),
        },
        profile: arguments.profile.map(ProfileSetting::Named),
        factor: arguments.factor.unwrap_or(usual.factor),
        offset: arguments.offset.unwrap_or(usual.offset),
        screen_plane: arguments.screen_plane,
        ..usual
    };
    display.validate()?;
    if LiveLayout::of(display.layout) == LiveLayout::None {
        bail!("layout {} is no picture with disparity; live sessions have the others", display.layout);
    }
    Ok(display)
}
