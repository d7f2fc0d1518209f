//! Decodes any bytes as a schema and a message of it. Decoded values must survive encoding and decoding.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pingmap_packet::{Field, Kind, Number, Rule, Schema};

/// Largest number of fields of a schema, including those of inner messages.
const FIELDS_MAX: usize = 24;

/// Reads a schema from the start of some bytes.
struct Source<'a> {
    bytes: &'a [u8],
    fields: usize,
}

impl Source<'_> {
    fn next(&mut self) -> u8 {
        let Some((&first, rest)) = self.bytes.split_first() else { return 0 };
        self.bytes = rest;
        first
    }

    fn number(&mut self) -> Kind {
        let resolution = [0.001, 0.1, 0.25, 1.0, 2.0, 5.0, 20.0][usize::from(self.next() % 7)];
        let (low, steps) = (i32::from(self.next()) - 128, i32::from(self.next()) * i32::from(self.next()));
        let multiple = |times: i32| {
            if resolution < 1.0 { f64::from(times) / (1.0 / resolution) } else { f64::from(times) * resolution }
        };
        let integer = self.next() % 2 == 0 && resolution >= 1.0;
        Kind::Number(Number { min: multiple(low), max: multiple(low + steps), resolution, integer })
    }

    fn kind(&mut self, depth: usize) -> Kind {
        match self.next() % 7 {
            0 => Kind::Bool,
            1 | 2 => self.number(),
            3 => {
                let values = (0..=self.next() % 6).map(|_| self.next()).map(|n| (format!("N{n}"), i32::from(n)));
                Kind::Enum { values: values.collect(), packed: false }
            }
            4 => Kind::Bytes { length_max: usize::from(self.next() % 6) },
            5 => Kind::Text { length_max: usize::from(self.next() % 6) },
            _ if depth == 0 => Kind::Bool,
            _ => Kind::Message(self.fields(depth - 1)),
        }
    }

    fn fields(&mut self, depth: usize) -> Vec<Field> {
        let count = self.next() % 6;
        let mut fields = Vec::new();
        for place in 0..count {
            self.fields += 1;
            if self.fields > FIELDS_MAX {
                break;
            }
            let (name, form, kind) = (format!("f{place}"), self.next(), self.kind(depth));
            let field = match form % 4 {
                0 => Field::required(&name, kind),
                1 => Field { presence: form & 8 != 0, ..Field::optional(&name, kind) },
                2 => {
                    let (min, more) = (usize::from(self.next() % 3), usize::from(self.next() % 4));
                    Field { rule: Rule::Repeated { min, max: min + more }, ..Field::required(&name, kind) }
                }
                _ => Field::optional(&name, kind).member_of("either"),
            };
            fields.push(if form & 16 != 0 { field.in_head() } else { field });
        }
        fields
    }
}

fuzz_target!(|bytes: &[u8]| {
    let mut source = Source { bytes, fields: 0 };
    let id = [None, Some(0), Some(127), Some(128), Some(300)][usize::from(source.next() % 5)];
    let fields = source.fields(2);
    let schema = Schema { name: "Test".into(), id, bytes_max: 0, fields };
    let schema = Schema { bytes_max: schema.length(), ..schema };
    let Ok(values) = schema.decode(source.bytes) else { return };
    let again = schema.encode(&values).expect("decoded values are within bounds");
    assert_eq!(schema.decode(&again).expect("encoded bytes are valid"), values);
});
