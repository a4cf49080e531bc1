//! A session of `relief client` with its connection.

use anyhow::bail;

use crate::client::arguments::{ClientArguments, Part};
use relief_client::{Access, Composer, Options};
use relief_display::{DisplaySettings, Layout, ProfileName, ProfileSetting};
use relief_live::{Accept, ColorFormat, Hello, LiveLayout, Role, Settings};

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
        let display = display_of(arguments)?;
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
        // What others of a shared view ask of the display is not known here.
        let is_own = role == Role::Presenter && (arguments.view.is_none() || display != usual);
        let asked = is_own.then(|| display.header());
        let profile = display.profile()?;
        #[cfg(feature = "window")]
        let frame_px = profile.frame_px();
        let composer = Composer::new(profile, asked);
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
            layout: display.layout,
            #[cfg(feature = "window")]
            frame_px,
        })
    }
}

/// The display that the arguments name.
fn display_of(arguments: &ClientArguments) -> anyhow::Result<DisplaySettings> {
    let usual = DisplaySettings::default();
    let of_profile = match arguments.profile {
        Some(ProfileName::Dimenco4k) => Layout::Wowvx4k,
        _ => usual.layout,
    };
    let display = DisplaySettings {
        layout: arguments.layout.unwrap_or(of_profile),
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
