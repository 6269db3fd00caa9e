//! System calls of a program, read from a log of `strace -f -xx`.

/// One side of a completed or interrupted call in the log's order.
#[derive(Debug)]
pub(crate) enum Moment {
    Entered(Call),
    /// The call with its result, negative if it failed.
    Left(Call, i64),
}

/// A call with its arguments as text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Call {
    /// Thread of the call.
    pub(crate) thread: u32,
    pub(crate) name: String,
    arguments: Vec<String>,
}

impl Call {
    /// Returns argument `index` as text, for flags; an absent argument is empty.
    pub(crate) fn text(&self, index: usize) -> &str {
        self.arguments.get(index).map_or("", String::as_str)
    }

    /// Returns a file descriptor; `None` stands for the current folder.
    pub(crate) fn fd(&self, index: usize) -> Option<i64> {
        self.text(index).parse().ok()
    }

    /// Returns a number, such as an offset or a length.
    pub(crate) fn number(&self, index: usize) -> usize {
        let text = self.text(index);
        text.parse().unwrap_or_else(|e| panic!("{text:?} in {self:?}: {e}"))
    }

    pub(crate) fn path(&self, index: usize) -> String {
        String::from_utf8(self.bytes(index)).expect("paths of the test are UTF-8")
    }

    /// Returns the bytes of all strings in an argument: a buffer, or the buffers of `writev` one after the other.
    pub(crate) fn bytes(&self, index: usize) -> Vec<u8> {
        let text = self.text(index);
        assert!(!text.contains("\"..."), "strace shortened {text:.80}");
        let strings = text.split('"').skip(1).step_by(2);
        strings.flat_map(|string| string.split("\\x").skip(1).map(byte)).collect()
    }
}

fn byte(hex: &str) -> u8 {
    u8::from_str_radix(hex, 16).unwrap_or_else(|e| panic!("{hex:?}: {e}"))
}

/// Reads a whole log.
pub(crate) fn parse(log: &str) -> Vec<Moment> {
    let mut moments = Vec::new();
    let mut begun: Vec<(u32, String)> = Vec::new();
    for line in log.lines() {
        let Some((thread, rest)) = line.split_once(' ') else { continue };
        let thread: u32 = thread.parse().unwrap_or_else(|e| panic!("{line:.80}: {e}"));
        let rest = rest.trim_start();
        if rest.starts_with("+++") || rest.starts_with("---") {
            continue;
        }
        if let Some(start) = rest.strip_suffix("<unfinished ...>") {
            moments.push(Moment::Entered(call(thread, start)));
            begun.push((thread, start.trim_end().to_owned()));
            continue;
        }
        let whole = if let Some(resumed) = rest.strip_prefix("<... ") {
            let (_, end) = resumed.split_once("resumed>").unwrap_or_else(|| panic!("{line}"));
            let at = begun.iter().position(|(of, _)| *of == thread);
            begun.swap_remove(at.unwrap_or_else(|| panic!("{line:.80}: never entered"))).1 + end
        } else {
            moments.push(Moment::Entered(call(thread, rest)));
            rest.to_owned()
        };
        // A call that its process never left has a `?` as its result.
        if let Some((arguments, result)) = whole.rsplit_once(" = ")
            && let Some(result) = result.split(' ').next().and_then(|word| word.parse().ok())
        {
            moments.push(Moment::Left(call(thread, arguments), result));
        }
    }
    moments
}

/// Reads `name(argument, argument)`, whose end may be missing.
fn call(thread: u32, text: &str) -> Call {
    let (name, rest) = text.split_once('(').unwrap_or_else(|| panic!("{text:.80} is no call"));
    let (mut arguments, mut depth, mut quoted) = (vec![String::new()], 0, false);
    for c in rest.chars() {
        match c {
            '"' => quoted = !quoted,
            '[' | '{' | '(' if !quoted => depth += 1,
            ')' if !quoted && depth == 0 => break,
            ']' | '}' | ')' if !quoted => depth -= 1,
            ',' if !quoted && depth == 0 => {
                arguments.push(String::new());
                continue;
            }
            _ => {}
        }
        if let Some(last) = arguments.last_mut() {
            last.push(c);
        }
    }
    let arguments = arguments.iter().map(|a| a.trim().to_owned()).collect();
    Call { thread, name: name.to_owned(), arguments }
}

#[test]
fn a_log_is_read_with_its_interrupted_calls() {
    let log = concat!(
        "7 openat(AT_FDCWD, \"\\x61\\x2f\\x62\", O_RDWR|O_CREAT, 0666 <unfinished ...>\n",
        "8 writev(5, [{iov_base=\"\\x22\", iov_len=1}, {iov_base=\"\\x00\\x29\", iov_len=2}], 2) = 3\n",
        "7 <... openat resumed>)  = 4\n",
        "8 unlink(\"\\x61\")  = -1 ENOENT (No such file or directory)\n",
        "8 exit_group(0) = ?\n",
        "7 +++ exited with 0 +++\n",
    );
    let left = parse(log).into_iter().filter_map(|moment| match moment {
        Moment::Left(call, result) => Some((call, result)),
        Moment::Entered(_) => None,
    });
    let [(writev, 3), (open, 4), (unlink, -1)] = &left.collect::<Vec<_>>()[..] else {
        panic!("three calls returned");
    };
    assert_eq!(writev.bytes(1), b"\"\0)");
    assert_eq!((open.fd(0), open.path(1), open.text(2)), (None, "a/b".into(), "O_RDWR|O_CREAT"));
    assert_eq!((unlink.thread, unlink.path(0)), (8, "a".to_owned()));
}
