//! The first message of a connection, and the formats that it leads to.

use serde::{Deserialize, Serialize};

use super::error::{MessageError, MessageFault};
use super::settings::Settings;
use crate::format::{ColorFormat, DepthFormat};
use relief_annotation::Item;

/// Most characters of the name of a view.
pub(crate) const MAX_VIEW_NAME: usize = 64;
/// Most formats that a client may list.
const MAX_FORMATS: usize = 16;
/// Maximum length of a client's name, characters.
const MAX_CLIENT_NAME: usize = 128;

/// The identity of a client and its requested role and formats.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hello {
    /// Program and version, for people who read logs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub client: Option<String>,
    /// The author of the annotations that this client places.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub author: Option<String>,
    /// Id of the volume; `null` is the first, or that of the view where it exists.
    pub volume: Option<String>,
    /// Name of a shared view, created if it does not exist; `null` creates a private view with a
    /// random name.
    pub view: Option<String>,
    /// The role.
    pub role: Role,
    /// The formats that the client can decode.
    pub accept: Accept,
    /// Size of the picture; `null` is that of the view, or of the layout.
    pub size_px: Option<[u32; 2]>,
    /// Token of a session that was interrupted; view and settings are then its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resume: Option<String>,
    /// As in a message `settings`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settings: Option<Settings>,
}

/// The role of a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Moves the view and changes its settings.
    #[default]
    Presenter,
    /// Look.
    Watcher,
}

/// Formats that a client reads, in the order of preference. Names that this version does not know
/// are passed over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Accept {
    /// Of colour; see [`ColorFormat`].
    pub color: Vec<String>,
    /// Of depth; see [`DepthFormat`].
    pub depth: Vec<String>,
}

impl Default for Accept {
    fn default() -> Self {
        let color = [ColorFormat::Jpeg, ColorFormat::RgbZstd].map(|format| format.name().to_owned());
        Self { color: color.to_vec(), depth: vec![DepthFormat::D8Zstd.name().to_owned()] }
    }
}

/// The formats agreed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Formats {
    /// Of colour while the view moves, and of a still one.
    pub color: ColorFormats,
    /// Of depth.
    pub depth: DepthFormat,
}

/// The formats of colour agreed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorFormats {
    /// While the view moves: the first of those accepted.
    pub moving: ColorFormat,
    /// Of a still view: the first lossless one, or else the same.
    pub still: ColorFormat,
}

/// No format that both sides know.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("accept.{what} contains no known format; known: {known}")]
pub struct NoFormat {
    /// `color` or `depth`.
    pub what: &'static str,
    /// Names.
    pub known: String,
}

impl Accept {
    /// The formats for a client that accepts these.
    ///
    /// # Errors
    /// When it lists none that is known.
    pub fn negotiate(&self) -> Result<Formats, NoFormat> {
        let known = |names: &[&str]| names.join(", ");
        let colors: Vec<ColorFormat> = self
            .color
            .iter()
            .filter_map(|name| ColorFormat::ALL.into_iter().find(|format| format.name() == name))
            .collect();
        let refused = || NoFormat { what: "color", known: known(&ColorFormat::ALL.map(ColorFormat::name)) };
        let moving = *colors.first().ok_or_else(refused)?;
        let still = colors.iter().copied().find(|format| format.is_lossless()).unwrap_or(moving);
        let depth = self
            .depth
            .iter()
            .find_map(|name| DepthFormat::ALL.into_iter().find(|format| format.name() == name));
        let refused = || NoFormat { what: "depth", known: known(&DepthFormat::ALL.map(DepthFormat::name)) };
        Ok(Formats { color: ColorFormats { moving, still }, depth: depth.ok_or_else(refused)? })
    }
}

impl Hello {
    pub(super) fn validate(&self) -> Result<(), MessageError> {
        if self.client.as_ref().is_some_and(|name| name.chars().count() > MAX_CLIENT_NAME) {
            return Err(MessageError::new("client", MessageFault::LongClient(MAX_CLIENT_NAME)));
        }
        if let Some(author) = &self.author {
            let characters = author.chars().count();
            if !(1..=Item::LONGEST_NAME).contains(&characters) || author.contains(char::is_control) {
                let fault = MessageFault::Author { found: characters, most: Item::LONGEST_NAME };
                return Err(MessageError::new("author", fault));
            }
        }
        if let Some(name) = &self.view {
            check_view_name(name)?;
        }
        for (path, formats) in [("accept.color", &self.accept.color), ("accept.depth", &self.accept.depth)] {
            if formats.len() > MAX_FORMATS {
                let fault = MessageFault::Formats { found: formats.len(), most: MAX_FORMATS };
                return Err(MessageError::new(path, fault));
            }
        }
        Ok(())
    }
}

/// Checks the name of a view: letters, digits, `-`, `_` and `.`, up to 64 characters.
///
/// # Errors
/// When it has other characters, none, or too many.
pub fn check_view_name(name: &str) -> Result<(), MessageError> {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte);
    if (1..=MAX_VIEW_NAME).contains(&name.len()) && name.bytes().all(plain) {
        return Ok(());
    }
    Err(MessageError::new("view", MessageFault::ViewName(MAX_VIEW_NAME)))
}
