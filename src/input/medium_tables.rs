//! The media of an experiment: `[medium]` with its flags, or a list `[[medium]]`.

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::settings::phase::PARAMETERS;
use crate::settings::setting::LeaveOut;
use crate::settings::table::MediumTable;

/// The media as the user wrote them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MediumTables {
    /// `[medium]` and the flags of a medium.
    pub one: MediumTable,
    /// `[[medium]]`. Empty if the file has no list.
    pub list: Vec<MediumTable>,
}

impl MediumTables {
    /// Prepares `below` for these media, which replace it in part: `--no-medium` removes all media, and a phase function removes the
    /// parameters that it does not have.
    pub fn replace_in(&self, below: &mut MediumTables) {
        if self.one.no_medium == Some(true) {
            *below = MediumTables::default();
        }
        if self.one != MediumTable::default() {
            below.one.no_medium = None;
        }
        let has_droplets = |table: &MediumTable| table.droplet_diameter.is_some();
        if let Some(phase) = &self.one.phase {
            let used = phase.parameters(has_droplets(&self.one) || has_droplets(&below.one));
            let unused: Vec<&str> = PARAMETERS.into_iter().filter(|name| !used.contains(name)).collect();
            below.one.visit(&mut LeaveOut(&unused));
        }
    }

    /// Merges two: the settings of `self`, and those of `below` that `self` does not give. A list counts as one setting.
    pub fn over(self, below: MediumTables) -> MediumTables {
        let list = if self.list.is_empty() { below.list } else { self.list };
        MediumTables { one: self.one.over(below.one), list }
    }
}

impl Serialize for MediumTables {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.list.is_empty() {
            true => Serialize::serialize(&self.one, serializer),
            false => self.list.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for MediumTables {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<MediumTables, D::Error> {
        deserializer.deserialize_any(TableOrList)
    }
}

struct TableOrList;

impl<'de> Visitor<'de> for TableOrList {
    type Value = MediumTables;

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("a map")
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<MediumTables, A::Error> {
        let one = Deserialize::deserialize(MapAccessDeserializer::new(map))?;
        Ok(MediumTables { one, list: vec![] })
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<MediumTables, A::Error> {
        let list = Deserialize::deserialize(SeqAccessDeserializer::new(list))?;
        Ok(MediumTables { one: MediumTable::default(), list })
    }
}
