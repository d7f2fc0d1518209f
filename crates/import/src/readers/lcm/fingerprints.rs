//! Fingerprints of LCM message types, with which their messages start.

use std::collections::BTreeMap;

use crate::readers::lcm::types::{DEPTH_MAX, Dimension, Kind, LcmTypes, Member, Struct};

/// Largest number of nested types that are hashed for all fingerprints.
const STEPS_MAX: usize = 1 << 18;

impl LcmTypes {
    /// Returns the name of each type by its fingerprint, with which its messages start.
    ///
    /// Types that nest too deep, or contain each other in circles too often, have none. Their messages are of unknown
    /// types.
    pub(crate) fn by_fingerprint(&self) -> BTreeMap<u64, &str> {
        let mut fingerprints = Fingerprints { types: self, known: BTreeMap::new(), parents: Vec::new(), steps: 0 };
        let names = self.0.keys().map(String::as_str);
        names.filter_map(|name| Some((fingerprints.of(name)?.0, name))).collect()
    }
}

/// Computes fingerprints. The cost is linear in the text of the definitions, except for types in circles.
struct Fingerprints<'a> {
    types: &'a LcmTypes,
    /// Fingerprints of types that contain no circle. They are the same wherever the type occurs.
    known: BTreeMap<&'a str, u64>,
    /// The types that contain the present one.
    parents: Vec<&'a str>,
    steps: usize,
}

impl<'a> Fingerprints<'a> {
    /// Returns the fingerprint of a type within its parents, and whether it contains a circle.
    fn of(&mut self, name: &'a str) -> Option<(u64, bool)> {
        if let Some(known) = self.known.get(name) {
            return Some((*known, false));
        }
        if self.parents.contains(&name) {
            return Some((0, true));
        }
        let Some(found) = self.types.0.get(name) else { return Some((0, false)) };
        self.steps += 1;
        if self.parents.len() >= DEPTH_MAX || self.steps > STEPS_MAX {
            return None;
        }
        self.parents.push(name);
        let sum = self.sum(found);
        self.parents.pop();
        let result = sum.map(|(sum, has_circle)| (sum.rotate_left(1), has_circle));
        if let Some((fingerprint, false)) = result {
            self.known.insert(name, fingerprint);
        }
        result
    }

    /// Returns the sum of a type's own hash and of the fingerprints of its members, and whether it contains a circle.
    fn sum(&mut self, found: &'a Struct) -> Option<(u64, bool)> {
        let (mut sum, mut has_circle) = (found.own_fingerprint(), false);
        for member in &found.members {
            if let Kind::Struct(name) = &member.kind {
                let (nested, is_circle) = self.of(name)?;
                sum = sum.wrapping_add(nested);
                has_circle |= is_circle;
            }
        }
        Some((sum, has_circle))
    }
}

impl Struct {
    /// Hashes the names, types and sizes of the members. The fingerprints of nested types are not included.
    fn own_fingerprint(&self) -> u64 {
        let mut found = Fingerprint(0x1234_5678);
        for Member { name, kind, dimensions } in &self.members {
            found.text(name);
            match kind {
                Kind::Number(name, _) => found.text(name),
                Kind::Text => found.text("string"),
                Kind::Struct(_) => {}
            }
            found.byte(dimensions.len() as u8);
            for dimension in dimensions {
                match dimension {
                    Dimension::Fixed(_, text) => {
                        found.byte(0);
                        found.text(text);
                    }
                    Dimension::Member(name) => {
                        found.byte(1);
                        found.text(name);
                    }
                }
            }
        }
        found.0 as u64
    }
}

struct Fingerprint(i64);

impl Fingerprint {
    fn byte(&mut self, byte: u8) {
        self.0 = ((self.0 << 8) ^ (self.0 >> 55)).wrapping_add(i64::from(byte as i8));
    }

    fn text(&mut self, text: &str) {
        self.byte(text.len() as u8);
        text.bytes().for_each(|byte| self.byte(byte));
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;

    use super::*;

    const TEXT: &str = "package pm; // navigation\nstruct point_t { double lat; double lon; }\n/* two\nlines */ struct nav_t {\n\
        const int32_t VERSION = 2, OTHER = 3; int64_t utime; point_t where; double depth; int8_t n; byte raw[n]; float cov[OTHER][2];\n\
        string name; boolean ok; }\nstruct modem_t { int64_t utime; string nmea; };";

    /// The expected values are those that the generator of LCM 1.5.3 writes for these types.
    #[test]
    fn fingerprints_agree_with_the_lcm_generator() {
        let mut types = LcmTypes::default();
        types.read(TEXT).unwrap();
        let own = |name: &str| types.0[name].own_fingerprint();
        assert_eq!(own("pm.modem_t"), 0x00c2_4517_2bc5_521f);
        assert_eq!(own("pm.point_t"), 0xd8ee_bdba_b19f_f671);
        assert_eq!(own("pm.nav_t"), 0x8fa9_0313_e0c7_4205);
        let mut types = LcmTypes::default();
        types.read("struct d_t { double a[3]; } struct e_t { int32_t k; e_t next[k]; d_t d; }").unwrap();
        assert_eq!(types.0["d_t"].own_fingerprint(), 0x21f0_a398_3cf3_355a);
        assert_eq!(types.0["e_t"].own_fingerprint(), 0x2fc5_951d_e629_0c92);
        let whole = 0x2fc5_951d_e629_0c92u64.wrapping_add(0x21f0_a398_3cf3_355a_u64.rotate_left(1)).rotate_left(1);
        assert!(types.by_fingerprint().contains_key(&whole));
    }

    /// Types that contain the next type `fan` times each, and the last one `end`.
    fn nested(depth: usize, fan: usize, end: &str) -> LcmTypes {
        let mut text = String::new();
        for level in 0..depth {
            let kind = if level + 1 < depth { format!("t{}", level + 1) } else { end.to_owned() };
            let members: Vec<String> = (0..fan).map(|index| format!("{kind} m{index};")).collect();
            writeln!(text, "struct t{level} {{ {} }}", members.join(" ")).unwrap();
        }
        let mut types = LcmTypes::default();
        types.read(&text).unwrap();
        types
    }

    /// Without memory the last three would take 10^16 steps.
    #[test]
    fn fingerprints_of_nested_types_take_bounded_work() {
        assert_eq!(nested(16, 10, "double").by_fingerprint().len(), 16);
        assert!(nested(24, 10, "double").by_fingerprint().len() >= 16);
        assert!(nested(16, 10, "t0").by_fingerprint().len() <= 16);
    }
}
