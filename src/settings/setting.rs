//! The description of a setting, and what tables of settings do with their values.

mod table_macro;

use std::ffi::OsStr;
use std::path::PathBuf;

use crate::error::{Error, Result, SettingsError};
use crate::settings::Estimator;
pub(crate) use table_macro::{table, value};

/// One setting: a flag of the command line, and the key of the same name in a table of an experiment file. Keyword arguments in Python
/// have this name too, with underscores.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// The flag is two dashes and this name.
    pub name: &'static str,
    /// The table of an experiment file that has the key.
    pub table: &'static str,
    /// Another name of the key, which experiment files of earlier versions have.
    pub old_key: Option<&'static str>,
    /// The letter of the short flag.
    pub short: Option<char>,
    /// Heading in the help text under which the flag is listed.
    pub heading: &'static str,
    /// Placeholder for the value in the help text.
    pub value: &'static str,
    pub help: &'static str,
    pub form: Form,
    /// Names of settings that exclude this one: the user can give at most one of them.
    pub excludes: &'static [&'static str],
    /// What this setting and each that it excludes both do, for messages.
    pub both: &'static str,
    /// Names of settings that belong to the choice made here. Another choice resets them.
    pub resets: &'static [&'static str],
    /// Minimum and maximum of the accepted values, both included, for a setting that is a count.
    pub limits: Option<(u32, u32)>,
    /// False: the setting only says where a render runs, where its files are, or what it refuses.
    pub affects_image: bool,
    takers: u8,
    used_by: fn(Estimator) -> bool,
}

/// A part of the program that takes some of the settings. `taugate render` takes all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Taker {
    /// `taugate info`
    Info = 1,
    /// `taugate view`
    View = 2,
    /// The page of the viewer, which changes settings while it renders. No setting of the page names a file.
    Page = 4,
    /// The Python module
    Python = 8,
}

/// How a flag takes its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// `--flag VALUE`
    Value,
    /// `--flag VALUE`, where the value may begin with a minus sign.
    Signed,
    /// `--flag VALUE`, any number of times.
    Repeated,
    /// `--flag VALUE`, any number of times, where the value may begin with a minus sign.
    SignedRepeated,
    /// `--flag` alone means true.
    Switch,
    /// `--flag` or `--flag VALUE`; the flag alone means `bare`. With `equals`, only `--flag=VALUE` gives a value.
    Optional { bare: &'static str, equals: bool },
}

impl Setting {
    const fn new(heading: &'static str, name: &'static str, value: &'static str) -> Setting {
        Setting {
            name,
            table: "",
            old_key: None,
            short: None,
            heading,
            value,
            help: "",
            form: Form::Value,
            excludes: &[],
            both: "",
            resets: &[],
            limits: None,
            affects_image: true,
            takers: 0,
            used_by: |_| true,
        }
    }

    pub const fn scene(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Scene", name, value).also(Taker::Info).also(Taker::View).also(Taker::Python)
    }

    pub const fn medium(name: &'static str, value: &'static str) -> Setting {
        Setting { heading: "Medium", ..Setting::scene(name, value) }
    }

    pub const fn gate(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Gate", name, value).also(Taker::View).also(Taker::Python)
    }

    pub const fn sampling(name: &'static str, value: &'static str) -> Setting {
        Setting { heading: "Sampling", ..Setting::gate(name, value) }
    }

    pub const fn output(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Output", name, value)
    }

    pub const fn long_render(name: &'static str, value: &'static str) -> Setting {
        Setting::new("Long renders", name, value)
    }

    pub const fn diagnostics(name: &'static str, value: &'static str) -> Setting {
        Setting { heading: "Diagnostics", ..Setting::gate(name, value) }.affects_no_image()
    }

    pub const fn table(self, table: &'static str) -> Setting {
        Setting { table, ..self }
    }

    pub const fn old_key(self, key: &'static str) -> Setting {
        Setting { old_key: Some(key), ..self }
    }

    pub const fn also(self, taker: Taker) -> Setting {
        Setting { takers: self.takers | taker as u8, ..self }
    }

    pub const fn except(self, taker: Taker) -> Setting {
        Setting { takers: self.takers & !(taker as u8), ..self }
    }

    pub fn is_for(&self, taker: Taker) -> bool {
        self.takers & taker as u8 != 0
    }

    pub const fn affects_no_image(self) -> Setting {
        Setting { affects_image: false, ..self }
    }

    pub const fn help(self, help: &'static str) -> Setting {
        Setting { help, ..self }
    }

    pub const fn short(self, letter: char) -> Setting {
        Setting { short: Some(letter), ..self }
    }

    pub const fn form(self, form: Form) -> Setting {
        Setting { form, ..self }
    }

    /// Excludes settings that stand before this one in the tables. `both`: what each of them and this one do.
    pub const fn excludes(self, others: &'static [&'static str], both: &'static str) -> Setting {
        Setting { excludes: others, both, ..self }
    }

    pub const fn resets(self, others: &'static [&'static str]) -> Setting {
        Setting { resets: others, ..self }
    }

    pub const fn within(self, min: u32, max: u32) -> Setting {
        Setting { limits: Some((min, max)), ..self }
    }

    /// Restricts the setting to the estimators for which `used_by` is true.
    pub const fn only_for(self, used_by: fn(Estimator) -> bool) -> Setting {
        Setting { used_by, ..self }
    }

    /// Whether the images of `estimator` depend on the setting.
    pub fn is_used_by(&self, estimator: Estimator) -> bool {
        (self.used_by)(estimator)
    }

    /// The mistake of giving this setting and `other`, which it excludes.
    pub fn clash(&self, other: &str) -> SettingsError {
        SettingsError::advice(format!("{other} and {} both {}: ", self.name, self.both), "keep one").about(self.name)
    }

    /// Fails if `count` is outside the limits; the message names the flag and the limits.
    pub fn check(&self, count: u32) -> Result<()> {
        let bounds = match self.limits {
            Some((min, max)) if !(min..=max).contains(&count) => match min {
                0 => format!("at most {max}"),
                _ => format!("from {min} to {max}"),
            },
            _ => return Ok(()),
        };
        Err(Error::advice(format!("--{} is {count}; ", self.name), format!("it must be {bounds}")))
    }

    /// A note for a user who gave the setting although `estimator` does not use it; `None` if `estimator` uses it.
    pub fn without_effect(&self, estimator: Estimator) -> Option<String> {
        if self.is_used_by(estimator) {
            return None;
        }
        let users: Vec<&str> =
            Estimator::ALL.into_iter().filter(|&e| self.is_used_by(e)).map(Estimator::name).collect();
        let users = match &users[..] {
            [one] => one.to_string(),
            [some @ .., last] => format!("{} and {last}", some.join(", ")),
            [] => "no estimator".into(),
        };
        Some(format!("--{} is only for {users}; {estimator} ignores it", self.name))
    }
}

/// A type of values that a setting can have.
pub trait Value: Clone + serde::Serialize + Send + Sync + 'static {
    /// Parses a word of the command line.
    fn parse(word: &OsStr) -> Result<Self, SettingsError>;

    /// The number that must be inside [`Setting::limits`]; `None` for a type without limits.
    fn count(&self) -> Option<u32> {
        None
    }

    /// The paths of the files and folders that the value names.
    fn paths(&mut self) -> Vec<&mut PathBuf> {
        vec![]
    }

    /// The value without empty names of files; `None` if nothing is left.
    fn without_empty_names(mut self) -> Option<Self> {
        let has_empty = self.paths().iter().any(|path| path.as_os_str().is_empty());
        (!has_empty).then_some(self)
    }

    /// Combines two values of a [`Form::Repeated`] flag: `self`, and `later`, which the user gave after it.
    fn and(self, later: Self) -> Self {
        later
    }
}

/// Implements [`Value`] with `FromStr`. A type may have further methods of [`Value`] in braces.
macro_rules! value_from_text {
    ($($type:ty $({ $($more:item)+ })?),+ $(,)?) => {$(
        impl $crate::settings::setting::Value for $type {
            fn parse(word: &std::ffi::OsStr) -> Result<Self, $crate::error::SettingsError> {
                Ok(word.to_str().ok_or("this is not UTF-8")?.parse::<$type>()?)
            }
            $($($more)+)?
        }
    )+};
}
pub(crate) use value_from_text;

value_from_text!(bool, String, u32 {
    fn count(&self) -> Option<u32> {
        Some(*self)
    }
});

impl Value for PathBuf {
    fn parse(word: &OsStr) -> Result<PathBuf, SettingsError> {
        Ok(word.into())
    }

    fn paths(&mut self) -> Vec<&mut PathBuf> {
        vec![self]
    }
}

/// Visits every setting of a table in turn.
pub trait Visitor {
    /// `slot` holds the value that the user gave, or `None`.
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>);
}

/// Removes the settings with these names.
pub struct LeaveOut<'a>(pub &'a [&'a str]);

impl Visitor for LeaveOut<'_> {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        slot.take_if(|_| self.0.contains(&setting.name));
    }
}

/// Collects the settings that the user gave, in the order of the tables.
#[derive(Default)]
pub struct Given(pub Vec<&'static Setting>);

impl Visitor for Given {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        self.0.extend(slot.is_some().then_some(setting));
    }
}

/// Checks the limits of the settings that the user gave, up to the first error.
pub struct CheckLimits(pub Result<()>);

impl Visitor for CheckLimits {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        if let (Ok(()), Some(count)) = (&self.0, slot.as_ref().and_then(T::count)) {
            self.0 = setting.check(count);
        }
    }
}
