//! The media of an experiment: `[medium]` with its flags, or a list `[[medium]]`.

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::settings::phase::Phase;
use crate::settings::setting;
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
    /// Merges the media of two experiments. `--no-medium` also removes the medium or the list of the file. Settings that exclude each
    /// other replace each other.
    pub fn over(self, mut below: MediumTables) -> MediumTables {
        let (above, beneath) = (&self.one, &mut below.one);
        let removes = above.no_medium == Some(true);
        if removes {
            *beneath = MediumTable::default();
        }
        if *above != MediumTable::default() {
            beneath.no_medium = None;
        }
        if above.visibility.is_some() || above.mor.is_some() {
            (beneath.sigma_s, beneath.sigma_a) = (None, None);
            (beneath.visibility, beneath.mor) = (None, None);
        }
        if above.sigma_s.is_some() || above.sigma_a.is_some() {
            (beneath.visibility, beneath.mor, beneath.albedo) = (None, None, None);
        }
        leave_phase_to(beneath, above);
        let list = if removes || !self.list.is_empty() { self.list } else { below.list };
        MediumTables { one: self.one.over(below.one), list }
    }

    /// Calls `visitor` with every setting of every table.
    pub fn visit(&mut self, visitor: &mut impl setting::Visitor) {
        self.one.visit(visitor);
        self.list.iter_mut().for_each(|table| table.visit(visitor));
    }
}

/// Removes from `beneath` the phase function that `above` replaces, and parameters that the phase function of `above` does not have.
fn leave_phase_to(beneath: &mut MediumTable, above: &MediumTable) {
    let parameters = [above.g.is_some(), above.g2.is_some(), above.weight.is_some(), above.alpha.is_some()];
    if parameters.contains(&true) {
        beneath.droplet_diameter = None;
    }
    let phase = match (&above.phase, above.droplet_diameter) {
        (Some(phase), _) => phase.clone(),
        (None, Some(_)) => Phase::Draine,
        (None, None) => return,
    };
    beneath.phase = None;
    let used = phase.parameters(above.droplet_diameter.or(beneath.droplet_diameter).is_some());
    let is_unused = |flag: &str| !used.contains(&flag);
    beneath.g.take_if(|_| is_unused("--phase-g"));
    beneath.g2.take_if(|_| is_unused("--phase-g2"));
    beneath.weight.take_if(|_| is_unused("--phase-weight"));
    beneath.alpha.take_if(|_| is_unused("--phase-alpha"));
    beneath.droplet_diameter.take_if(|_| is_unused("--droplet-diameter"));
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
