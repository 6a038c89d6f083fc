//! Text for terminals: tables that fit their width and say what they leave out, wrapped sentences, colour.

use std::fmt::Write as _;

/// How text is laid out.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Whether terminal colours may be used.
    pub color: bool,
    /// Characters per line; at least 40 are used.
    pub width: usize,
}

/// Whether something is good, as a colour of the terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// Green.
    Good,
    /// Yellow.
    Odd,
    /// Bold red.
    Bad,
    /// As the rest.
    Plain,
}

impl Tone {
    /// Good or bad.
    #[must_use]
    pub const fn of(good: bool) -> Self {
        if good { Self::Good } else { Self::Bad }
    }
}

impl Style {
    /// The same, at least 40 characters wide.
    #[must_use]
    pub fn legible(self) -> Self {
        Self {
            width: self.width.max(40),
            ..self
        }
    }

    fn paint(self, code: &str, text: &str) -> String {
        if self.color && !code.is_empty() {
            format!("\u{1b}[{code}m{text}\u{1b}[0m")
        } else {
            text.to_owned()
        }
    }

    /// Bold text.
    #[must_use]
    pub fn bold(self, text: &str) -> String {
        self.paint("1", text)
    }

    /// Text in the colour of `tone`.
    #[must_use]
    pub fn toned(self, tone: Tone, text: &str) -> String {
        let code = match tone {
            Tone::Good => "32",
            Tone::Odd => "33",
            Tone::Bad => "1;31",
            Tone::Plain => "",
        };
        self.paint(code, text)
    }
}

/// A column: its title, whether it is aligned right, and how readily it is left out (0: never).
#[derive(Clone, Copy, Debug)]
pub struct Column<'a> {
    title: &'a str,
    right: bool,
    dispensable: u8,
}

/// A column of a table.
#[must_use]
pub const fn column(title: &str, right: bool, dispensable: u8) -> Column<'_> {
    Column {
        title,
        right,
        dispensable,
    }
}

/// A heading on a line of its own.
pub fn heading(out: &mut String, text: &str, style: Style) {
    let _ = writeln!(out, "{}", style.bold(text));
}

/// Longest line of sentences: longer ones are hard to read, however wide a terminal is.
const MOST_PROSE: usize = 110;

/// Text broken between words to fit the width; lines after the first are indented by `indent`.
pub fn prose(out: &mut String, first: &str, indent: usize, text: &str, style: Style) {
    let width = style.width.min(MOST_PROSE);
    let (mut line, mut empty) = (first.to_owned(), true);
    for word in text.split(' ') {
        let needed = line.chars().count() + usize::from(!empty) + word.chars().count();
        if needed > width && !empty {
            let _ = writeln!(out, "{line}");
            (line, empty) = (" ".repeat(indent), true);
        }
        if !empty {
            line.push(' ');
        }
        line.push_str(word);
        empty = false;
    }
    let _ = writeln!(out, "{line}");
}

/// Rows under their titles; `tones` colours the cell of each row in `toned`. Columns for which there is no
/// room are named in a line below; their titles are returned.
pub fn grid<'a>(
    out: &mut String,
    columns: &[Column<'a>],
    rows: &[Vec<String>],
    toned: Option<(usize, &[Tone])>,
    style: Style,
) -> Vec<&'a str> {
    let widths: Vec<usize> = (0..columns.len())
        .map(|at| {
            let cells = rows.iter().map(|row| row[at].chars().count());
            let title = columns[at].title.chars().count();
            cells.max().unwrap_or(0).max(title)
        })
        .collect();
    let shown = fitting(columns, &widths, style.width);
    let last = shown.last().copied();
    let line = |cell: &dyn Fn(usize) -> (String, Tone)| {
        let parts = shown.iter().map(|&at| {
            let (text, tone) = cell(at);
            let fill = " ".repeat(widths[at].saturating_sub(text.chars().count()));
            let text = style.toned(tone, &text);
            match (columns[at].right, Some(at) == last) {
                (true, _) => format!("{fill}{text}"),
                (false, true) => text,
                (false, false) => format!("{text}{fill}"),
            }
        });
        parts.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let titles = line(&|at| (columns[at].title.to_owned(), Tone::Plain));
    let _ = writeln!(out, "{}", style.paint("2", &titles));
    for (index, row) in rows.iter().enumerate() {
        let tone = |at: usize| match toned {
            Some((column, tones)) if column == at => tones[index],
            _ => Tone::Plain,
        };
        let _ = writeln!(out, "{}", line(&|at| (row[at].clone(), tone(at))));
    }
    let left_out = (0..columns.len()).filter(|at| !shown.contains(at));
    let left_out: Vec<&'a str> = left_out.map(|at| columns[at].title).collect();
    if !left_out.is_empty() {
        let text = format!(
            "{}: no room in {} characters; a wider terminal, COLUMNS=200 or --json shows them",
            left_out.join(", "),
            style.width
        );
        prose(out, "left out: ", 2, &text, style);
    }
    left_out
}

/// The columns that fit, after leaving out the most dispensable ones.
fn fitting(columns: &[Column<'_>], widths: &[usize], width: usize) -> Vec<usize> {
    let mut shown: Vec<usize> = (0..columns.len()).collect();
    loop {
        let needed: usize = shown.iter().map(|&at| widths[at] + 2).sum();
        let least_needed = shown
            .iter()
            .copied()
            .filter(|&at| columns[at].dispensable > 0)
            .max_by_key(|&at| columns[at].dispensable);
        match least_needed {
            Some(at) if needed > width + 2 => shown.retain(|&other| other != at),
            _ => return shown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(width: usize, color: bool) -> (String, Vec<&'static str>) {
        let columns = [
            column("name", false, 0),
            column("a long title", true, 1),
            column("mark", false, 0),
        ];
        let rows = [
            vec!["x".to_owned(), "12".to_owned(), "ok".to_owned()],
            vec!["yy".to_owned(), "3".to_owned(), "FAIL".to_owned()],
        ];
        let mut out = String::new();
        let tones = [Tone::Good, Tone::Bad];
        let style = Style { color, width };
        let left_out = grid(&mut out, &columns, &rows, Some((2, &tones)), style);
        (out, left_out)
    }

    #[test]
    fn a_column_without_room_is_named() {
        let (wide, none) = table(40, false);
        assert!(wide.contains("a long title\n") || wide.contains("a long title  mark"));
        assert!(none.is_empty() && !wide.contains("left out"));
        let (narrow, gone) = table(12, false);
        assert_eq!(gone, ["a long title"]);
        assert!(narrow.contains("left out: a\n"), "{narrow}");
    }

    #[test]
    fn only_the_toned_cell_has_colour() {
        let (text, _) = table(40, true);
        assert!(
            text.contains("\u{1b}[32mok\u{1b}[0m") && text.contains("\u{1b}[1;31mFAIL\u{1b}[0m")
        );
        let (plain, _) = table(40, false);
        assert!(!plain.contains('\u{1b}'));
    }
}
