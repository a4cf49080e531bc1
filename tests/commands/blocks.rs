//! Commands in the blocks of code of a document.

/// A command, with the line of the document where it begins.
#[derive(Debug, PartialEq)]
pub(super) struct Block {
    pub(super) line: usize,
    pub(super) command: String,
}

/// The commands of all blocks of a shell, in order. A command goes on while a quotation is open or a
/// line ends in a backslash.
pub(super) fn blocks(text: &str) -> Vec<Block> {
    let (mut found, mut is_shell) = (Vec::new(), false);
    let mut open: Option<Block> = None;
    for (line, written) in (1..).zip(text.lines()) {
        if written.starts_with("```") {
            is_shell = written == "```sh";
            continue;
        }
        if !is_shell || (open.is_none() && written.trim().is_empty()) {
            continue;
        }
        let mut command = match open.take() {
            Some(begun) => Block { command: format!("{}\n{written}", begun.command), ..begun },
            None => Block { line, command: written.to_owned() },
        };
        if is_complete(&command.command) {
            command.command = without_comment(&command.command);
            found.extend(Some(command).filter(|command| !command.command.is_empty()));
        } else {
            open = Some(command);
        }
    }
    found
}

/// Quotation marks in a comment do not count.
fn is_complete(command: &str) -> bool {
    let command = without_comment(command);
    command.matches('\'').count().is_multiple_of(2) && !command.trim_end().ends_with('\\')
}

/// Without a comment at the end, which begins with two blanks and a `#`.
fn without_comment(command: &str) -> String {
    let end = command.find("  #").or_else(|| command.find(" # ")).unwrap_or(command.len());
    command[..end].trim().to_owned()
}

#[test]
fn commands_of_several_lines_and_comments_are_read() {
    let text =
        "a\n```sh\nrelief x   # the user's\ncurl -d '{\n}' y\nrelief \\\n  z\n\n```\nb\n```json\n{}\n```\n";
    let found: Vec<_> = blocks(text).into_iter().map(|block| (block.line, block.command)).collect();
    let expected = [(3, "relief x"), (4, "curl -d '{\n}' y"), (6, "relief \\\n  z")];
    assert_eq!(found, expected.map(|(line, command)| (line, command.to_owned())));
}
