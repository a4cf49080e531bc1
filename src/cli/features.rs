//! The features of this build, and the error message for a command or an option of a missing feature.

use clap::error::{ContextKind, ContextValue, ErrorKind};

/// An optional part of the program, chosen when it is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Feature {
    /// Name for cargo.
    pub(crate) name: &'static str,
    /// Whether this build has it.
    pub(crate) is_built: bool,
    /// What it adds.
    pub(crate) adds: &'static str,
    /// Its commands and options.
    words: &'static [&'static str],
}

/// All of them, by name.
pub(crate) const FEATURES: [Feature; 8] = [
    Feature {
        name: "archives",
        is_built: cfg!(feature = "archives"),
        adds: "DICOM archives by DICOMweb and the DICOM network",
        words: &[
            "receive",
            "send",
            "--archive",
            "--archive-results",
            "--receive",
            "--receive-caller",
            "--send",
        ],
    },
    Feature {
        name: "buckets",
        is_built: cfg!(feature = "buckets"),
        adds: "series and results in S3 buckets",
        words: &[],
    },
    Feature {
        name: "ipopt",
        is_built: cfg!(feature = "ipopt"),
        adds: "IPOPT for `relief track --solver ipopt`",
        words: &[],
    },
    Feature {
        name: "jpeg-ls",
        is_built: cfg!(feature = "jpeg-ls"),
        adds: "slices in JPEG-LS; building needs cmake and a C++ compiler",
        words: &[],
    },
    Feature {
        name: "postgres",
        is_built: cfg!(feature = "postgres"),
        adds: "logs of annotations in PostgreSQL",
        words: &[],
    },
    Feature {
        name: "queue",
        is_built: cfg!(feature = "queue"),
        adds: "batches from a NATS queue",
        words: &["submit", "work"],
    },
    Feature {
        name: "traces",
        is_built: cfg!(feature = "traces"),
        adds: "traces for an OpenTelemetry collector",
        words: &["--traces"],
    },
    Feature {
        name: "window",
        is_built: cfg!(feature = "window"),
        adds: "the window of `relief client`, on X11",
        words: &["--fullscreen", "--windowed", "--monitor", "--rest", "--clean"],
    },
];

/// The message about something that belongs to a feature which this build lacks.
pub(crate) fn lacks(what: &str, feature: &str) -> String {
    format!(
        "`{what}` is not in this build: build relief with --features {feature}, \
         for example: cargo install --path . --features {feature}"
    )
}

/// The message where the command line names a command or an option that this build lacks.
pub(crate) fn explain(error: &clap::Error) -> Option<String> {
    let kind = match error.kind() {
        ErrorKind::InvalidSubcommand => ContextKind::InvalidSubcommand,
        ErrorKind::UnknownArgument => ContextKind::InvalidArg,
        _ => return None,
    };
    let Some(ContextValue::String(word)) = error.get(kind) else { return None };
    let word = word.split(['=', ' ']).next().unwrap_or(word);
    let lacking = FEATURES.iter().filter(|feature| !feature.is_built);
    let feature = lacking.into_iter().find(|feature| feature.words.contains(&word))?;
    Some(lacks(word, feature.name))
}

#[cfg(test)]
mod tests {
    use clap::{Command, CommandFactory};

    use super::*;

    /// Whether a command, or one below it, has this subcommand or option.
    fn knows(command: &Command, word: &str) -> bool {
        let is_option = |argument: &clap::Arg| argument.get_long() == word.strip_prefix("--");
        command.get_arguments().any(is_option)
            || command.get_subcommands().any(|below| below.get_name() == word || knows(below, word))
    }

    #[test]
    fn words_of_a_feature_are_known_where_it_is_built() {
        let command = crate::CommandLine::command();
        for feature in FEATURES {
            for word in feature.words {
                assert!(knows(&command, word) || !feature.is_built, "{word} of {}", feature.name);
            }
        }
    }

    #[test]
    fn a_missing_command_names_its_feature() {
        let parse = |line: &str| <crate::CommandLine as clap::Parser>::try_parse_from(line.split(' '));
        let lines = [
            ("archives", "relief receive --out inbox"),
            ("queue", "relief batch work --out x"),
            ("traces", "relief serve --traces http://localhost"),
            ("window", "relief client --server http://localhost --fullscreen"),
        ];
        for (name, line) in lines {
            let is_built = FEATURES.iter().any(|feature| feature.name == name && feature.is_built);
            let said = parse(line).err().and_then(|error| explain(&error));
            assert_eq!(said.is_none(), is_built, "{line}: {said:?}");
            assert!(said.is_none_or(|said| said.contains(&format!("--features {name}"))), "{line}");
        }
        assert_eq!(parse("relief sing").err().and_then(|error| explain(&error)), None);
    }
}
