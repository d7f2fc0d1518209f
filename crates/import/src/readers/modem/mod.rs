//! The output of acoustic modems: NMEA sentences of the WHOI Micro-Modem, and transmissions in Goby's text format.

pub(crate) mod nmea;
mod sentence_names;
mod cycle;
mod flexible_packet;
mod transmitter;
mod receiver;
pub(crate) mod micromodem;
pub(crate) mod goby;
pub(crate) mod capture;
pub(crate) mod stream;
