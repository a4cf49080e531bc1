//! `relief token`: the tokens by which a server recognises its callers.

use std::path::PathBuf;
use std::process::ExitCode;

use serde_json::json;

use crate::output::{print_json, say};
use relief_annotation::Timestamp;
use relief_server::{NewToken, Scope, TokenEntry, add_token, read_tokens, remove_token};

/// Make, list and remove the tokens of `relief serve --token-file`
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The file has the SHA-256 of each token, not the token: it is printed once, when it is made. A server
reads the file again within a second of a change; sessions of a removed token end.

Scopes: view looks at volumes and annotations; annotate changes annotations, too; admin adds and
removes volumes, too. The name of a token is the author of what its holder changes.

Examples:
  relief token add tokens --name anna --scope annotate --days 90
  relief token list tokens
  relief token remove tokens --name anna
  relief serve --series head --listen 0.0.0.0:8080 --token-file tokens --tls-self-signed tls
  curl -H \"Authorization: Bearer $RELIEF_TOKEN\" --cacert tls/relief-certificate.pem https://localhost:8080/v1/volumes")]
pub(super) struct TokenArguments {
    #[command(subcommand)]
    command: TokenCommand,
}

#[derive(Debug, clap::Subcommand)]
enum TokenCommand {
    /// Make a token, add its hash to the file and print it
    Add {
        /// The file of tokens; created if it does not exist
        file: PathBuf,
        /// Name of the holder; it becomes the author of the holder's edits
        #[arg(long, value_name = "NAME")]
        name: String,
        /// The rights of the holder
        #[arg(long, value_enum, default_value_t = ScopeArgument::View)]
        scope: ScopeArgument,
        /// Lifetime; without it, the token is valid for ever
        #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u16).range(1..=3660))]
        days: Option<u16>,
    },
    /// List names, scopes and ends
    List {
        /// The file of tokens
        file: PathBuf,
        /// Print one JSON object
        #[arg(long)]
        json: bool,
    },
    /// Remove a token
    Remove {
        /// The file of tokens
        file: PathBuf,
        /// The holder
        #[arg(long, value_name = "NAME")]
        name: String,
    },
}

/// A scope on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum ScopeArgument {
    /// Look at volumes and annotations
    View,
    /// Change annotations, too
    Annotate,
    /// Add and remove volumes, too
    Admin,
}

impl From<ScopeArgument> for Scope {
    fn from(argument: ScopeArgument) -> Self {
        match argument {
            ScopeArgument::View => Self::View,
            ScopeArgument::Annotate => Self::Annotate,
            ScopeArgument::Admin => Self::Admin,
        }
    }
}

pub(super) fn run(arguments: TokenArguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        TokenCommand::Add { file, name, scope, days } => {
            let expires = days.and_then(|days| {
                Timestamp::from_millis(Timestamp::now().millis() + i64::from(days) * 24 * 3600 * 1000)
            });
            let token = add_token(&file, NewToken { name, scope: scope.into(), expires })?;
            say!("{token}");
            eprintln!("the token is not stored: keep it now, or make another");
        }
        TokenCommand::List { file, json } => list(&read_tokens(&file)?, json)?,
        TokenCommand::Remove { file, name } => {
            remove_token(&file, &name)?;
            eprintln!("removed; servers that use the file refuse the token within a second");
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn list(entries: &[TokenEntry], as_json: bool) -> anyhow::Result<()> {
    let now = Timestamp::now();
    if as_json {
        let rows: Vec<_> = entries
            .iter()
            .map(|entry| {
                json!({ "name": entry.name, "scope": entry.scope, "expires": entry.expires,
                    "valid": entry.is_valid_at(now) })
            })
            .collect();
        return print_json(&json!({ "tokens": rows }));
    }
    for entry in entries {
        let ends = match entry.expires {
            None => "never expires".to_owned(),
            Some(expires) if entry.is_valid_at(now) => format!("until {expires}"),
            Some(expires) => format!("expired {expires}"),
        };
        say!("{:<8}  {}  {ends}", entry.scope.name(), entry.name);
    }
    Ok(())
}
