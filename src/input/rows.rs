//! CSV files of numbers.

use std::path::Path;

use crate::files::{check_readable, read_error};

/// Maximum size of a file in bytes; a thousand rows have 20,000 bytes.
const MAX_BYTES: u64 = 8 << 20;

/// Reads the rows of a table with these columns. `row` says what a row is, like "a cosine and a value", and `example` is one, like "-1,0.05". A
/// header may have other names, but must not have these in another order. The error is one sentence that names the file and the line.
pub(super) fn read<const N: usize>(
    path: &Path,
    columns: [&str; N],
    row: &str,
    example: &str,
) -> Result<Vec<[f64; N]>, String> {
    let name = path.display();
    let length = check_readable(path).map_err(|e| e.to_string())?;
    if length > MAX_BYTES {
        return Err(format!(
            "{name} has {length} bytes, too many for a table: use fewer rows, at most {MAX_BYTES} bytes"
        ));
    }
    let bytes = std::fs::read(path).map_err(|e| read_error(path, e).to_string())?;
    let text = String::from_utf8(bytes)
        .map_err(|_| format!("{name} is not text: give a CSV file with {row} per line, like {example}"))?;
    rows(&text, columns, row, example).map_err(|message| format!("{name}:{message}"))
}

/// The rows of a table. Lines that are empty or begin with `#` do not count; the first other line may be a header. The error begins with
/// the number of the line.
fn rows<const N: usize>(text: &str, columns: [&str; N], row: &str, example: &str) -> Result<Vec<[f64; N]>, String> {
    let mut found = vec![];
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    for (index, (number, line)) in lines.enumerate() {
        let cells: Result<Vec<f64>, _> = line.split(',').map(|cell| cell.trim().parse::<f64>()).collect();
        match cells.map(<[f64; N]>::try_from) {
            Ok(Ok(cells)) => found.push(cells),
            Err(_) if index == 0 => check_header(line, columns).map_err(|message| format!("{number}: {message}"))?,
            _ => return Err(format!("{number}: '{line}' is not a row: write {row}, like {example}")),
        }
    }
    match found.is_empty() {
        true => Err(format!("1: the table has no rows: write {row} per line, like {example}")),
        false => Ok(found),
    }
}

/// Fails if a header has a column in another place. Units may follow the names.
fn check_header<const N: usize>(header: &str, columns: [&str; N]) -> Result<(), String> {
    let names = header.split(',').map(|cell| cell.split_whitespace().next().unwrap_or_default().to_lowercase());
    let is_elsewhere = |(place, name): (usize, String)| {
        columns.iter().position(|column| *column == name).is_some_and(|at| at != place)
    };
    match names.enumerate().any(is_elsewhere) {
        true => {
            Err(format!("the columns '{header}' have another order than {}: change their order", columns.join(",")))
        }
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn tables_are_read() {
        let rows = |text: &str| super::rows(text, ["cosine", "value"], "a cosine and a value", "-1,0.05");
        let expected = Ok(vec![[-1.0, 0.5], [0.0, 1e-3], [1.0, 8.0]]);
        assert_eq!(rows("-1,0.5\n0, 1e-3\n1,8"), expected);
        assert_eq!(rows("Cosine [1],weight\n-1,0.5\n0,1e-3\n1,8"), expected);
        assert_eq!(rows("# of fog\n\ncosine, value\n-1,0.5\n # middle\n0,0.001\r\n1,8\n"), expected);
        for (text, part) in [
            ("", "1: the table has no rows"),
            ("cosine,value\n", "1: the table has no rows"),
            ("-1,1\n0.5\n1,1", "2: '0.5' is not a row"),
            ("cosine,value\nangle,value\n1,1", "2: 'angle,value'"),
            ("-1,1,2", "1: '-1,1,2' is not a row"),
            ("value,cosine\n1,1", "1: the columns 'value,cosine' have another order than cosine,value"),
        ] {
            assert!(rows(text).unwrap_err().starts_with(part), "{text}");
        }
    }
}
