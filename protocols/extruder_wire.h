// The link between host and extruder board: messages and codes. One header for both sides; it
// compiles as C++14 with avr-g++ (no standard library there) and as C++20 on the host.
//
// Bytes and rules: FORMATS.md, "Extruder link". 115200 baud. Units: temperatures in tenths of a
// degree Celsius, filament lengths in micrometres, filament speeds in micrometres per second, times
// in milliseconds, positions in microsteps (+ feeds towards the nozzle).
//
// Rules both sides may rely on
//  1. Orders (kCommand, kClearFault, kSetSetting, kSaveSettings) count their own sequence: 1 after
//     a hello with a new session, then +1 each, wrapping 255 -> 0. One order is outstanding at a
//     time, except that M71 and M73 may follow at any time. Asking frames (kHello, kHeartbeat,
//     kStatusQuery, kGetSetting) carry any number; the answer repeats it.
//  2. Every order is answered with kAck within milliseconds; an accepted order is followed by
//     exactly one kDone, when what it asked for is physically so (M70: deployed and at temperature;
//     M72: retracted length restored, extrusion begins; M73: stopped; M74: retracted; M71:
//     retreated, heater off), or when it failed. kDone is what RIG.md calls "acknowledged".
//  3. An order delivered twice is answered twice (kAck, and kDone if it is over) and executed once.
//     An order older than the last one is refused (kStale).
//  4. The board obeys no order before a hello since its reset: a board that reset in mid-job stays
//     cold and still.
//  5. Any valid frame feeds the dead-man. Silence drops extrusion, then heat, and the hold output.
//  6. A banner with session 0 means the board has just reset.
#pragma once

#include <stdint.h>

#include "protocols/extruder_frame.h"

namespace reforge {
namespace wire {

constexpr uint8_t kProtocolVersion = 1;
constexpr int16_t kTemperatureUnknown = -32768;
constexpr int32_t kUseSetting = 0;  // a command's argument: take the value from the settings

enum class State : uint8_t {
  kClosed = 0,      // module closed, heater off
  kOpening = 1,     // M70: deploying and heating
  kReady = 2,       // open, at temperature, filament standing still
  kRestoring = 3,   // M72: pushing the retracted length back
  kExtruding = 4,   // M72
  kStopping = 5,    // M73 (or M75): ramping down
  kRetracting = 6,  // M74
  kClosing = 7,     // M71: retreating
  kStandby = 8,     // open but unheated, after a cleared fault: M70 or M71
  kFault = 9,       // latched: outputs safe, module left where it is
  kRetracted = 10,  // M74 has come to its end and is still on: M75 before M72
};
constexpr uint8_t kStateCount = 11;

// Why an order was refused (kAck), or did not come to its end (kDone).
enum class Reason : uint8_t {
  kNone = 0,  // accepted; done
  kFaultLatched = 1,
  kNoHello = 2,
  kStale = 3,
  kBusy = 4,  // another order is under way
  kUnknownCommand = 5,
  kBadArgument = 6,  // outside the board's limits
  kNotOpen = 7,      // module is closed or not ready: M70 first
  kTooCold = 8,      // extrusion or retraction under the minimum temperature
  kNoFilament = 9,
  kExtrusionOn = 10,   // M74 (or M70) while M72 is on
  kRetractionOn = 11,  // M72 while M74 is on: M75 first
  kNotIdle = 12,       // settings change only while the module is closed
  kUnknownSetting = 13,
  kFaultPersists = 14,  // the cause of the fault is still there
  kSuperseded = 15,     // ended by a later M71 or M73
  kFaulted = 16,        // ended by a fault
  kWrongVersion = 17,
  kPending = 18,       // in Status::last_result only: not over yet
  kInStreamOnly = 19,  // the board is wired to the CNC's outputs and takes no M-codes here
  kSaveFailed = 20,    // the EEPROM does not read back what was written
};
constexpr uint8_t kReasonCount = 21;

enum class Fault : uint8_t {
  kNone = 0,
  kSensorOpen = 1,
  kSensorShort = 2,
  kOverTemperature = 3,
  kNoRise = 4,
  kRunaway = 5,
  kSilence = 6,           // no valid frame while heating or open
  kExtrusionSilence = 7,  // no valid frame while extruding
  kFilamentOut = 8,       // ran out while extruding
  kInputConflict = 9,     // in-stream: extrude and retract inputs together
  kCncStopped = 10,       // in-stream: extruding while the CNC-running input is off
  kInternal = 11,         // an invariant of ours did not hold
  kHeaterTimeout = 12,    // M70 did not reach its temperature in time
  kRefusedInput = 13,     // in-stream: the CNC asked for what the state does not allow
};
constexpr uint8_t kFaultCount = 14;

// Bits of Banner::reset_cause, as the ATmega328P reports them.
constexpr uint8_t kResetPowerOn = 1;
constexpr uint8_t kResetExternal = 2;  // button, or DTR when a port is opened
constexpr uint8_t kResetBrownOut = 4;
constexpr uint8_t kResetWatchdog = 8;

enum class Setting : uint8_t {
  kStepsPerMetre = 0,        // microsteps per metre of filament
  kFilamentSpeed = 1,        // um/s, M72 without argument
  kAcceleration = 2,         // um/s^2 of filament
  kRetractLength = 3,        // um, M74 without argument
  kRetractSpeed = 4,         // um/s, M74 and the restoring of M72
  kTargetTemperature = 5,    // 0.1 C, M70 without argument
  kMinimumTemperature = 6,   // 0.1 C, no filament moves below
  kMaximumTemperature = 7,   // 0.1 C, cut-off
  kHeaterFitted = 8,         // 0: the rig's own controller heats, temperature is unknown
  kSilence = 9,              // ms, dead-man of heat
  kExtrusionSilence = 10,    // ms, dead-man of extrusion
  kModuleTravel = 11,        // ms the module needs to open or close
  kServoOpen = 12,           // us pulse
  kServoClosed = 13,         // us pulse
  kFilamentSensor = 14,      // 0 none, 1 fitted
  kReverseDirection = 15,    // 0 or 1
  kPidP = 16,                // 1/256 of full power per 0.1 C, times 256
  kPidI = 17,                // the same per second
  kPidD = 18,                // the same times seconds
  kRiseTemperature = 19,     // 0.1 C that must be gained ...
  kRiseTime = 20,            // ... in this many ms while heating up
  kRunawayTemperature = 21,  // 0.1 C below target ...
  kRunawayTime = 22,         // ... for this many ms once it was reached
  kHeatUpTime = 23,          // ms M70 may take at most
  kInStream = 24,            // 1: M70-M75 come by the CNC's outputs
  kTextSilence = 25,         // ms, dead-man of heat for a person at a terminal
};
constexpr uint8_t kSettingCount = 26;

// Messages.

struct Hello {
  uint8_t protocol_version;
  uint16_t session;  // not 0; a new one starts the order sequence afresh, the same one nothing
};

struct Command {
  uint8_t m_code;    // 70..75
  int32_t argument;  // M70 target 0.1 C; M72 filament um/s; M74 length um; otherwise kUseSetting
};

struct GetSetting {
  Setting id;
};

struct SetSetting {
  Setting id;
  int32_t value;
};

struct SettingValue {
  Setting id;
  int32_t value;
};

struct Banner {
  uint8_t protocol_version;
  uint8_t version_major;
  uint8_t version_minor;
  uint8_t version_patch;
  uint8_t reset_cause;   // kReset* bits
  uint16_t config_hash;  // CRC of all settings' values in the order of their ids, 4 bytes each
  uint16_t session;      // 0: just reset; otherwise that of the hello
  State state;
  Fault fault;
};

struct Ack {
  Reason reason;  // kNone: accepted
  State state;    // after the order
};

struct Done {
  Reason reason;  // kNone: as asked
  State state;
  int32_t position;  // microsteps at that moment
};

struct Beat {
  State state;
  Fault fault;
};

struct FaultReport {
  Fault fault;
  State state_before;
  int16_t temperature;  // 0.1 C or kTemperatureUnknown
  int32_t position;
};

// Bits of Status::flags.
constexpr uint8_t kFlagFilamentPresent = 1;  // true as well when no sensor is fitted
constexpr uint8_t kFlagModuleOpen = 2;
constexpr uint8_t kFlagHeating = 4;       // a target is set
constexpr uint8_t kFlagRunPermitted = 8;  // the hold output is energised: the CNC may run

struct Status {
  State state;
  Fault fault;
  uint8_t flags;
  int16_t temperature;    // 0.1 C or kTemperatureUnknown
  int16_t target;         // 0.1 C, 0 = off
  int32_t position;       // microsteps since reset
  int32_t retracted;      // microsteps pulled back and not yet restored, >= 0
  int32_t speed;          // um/s commanded by M72 now, 0 when not extruding
  uint8_t last_sequence;  // of the last order
  Reason last_result;     // of the last order; kPending while under way
  uint32_t uptime;        // ms since reset
};

// pack(message, sequence) makes the frame; unpack(frame, message) is false when type
// or length differ

// A frame without payload: kHeartbeat, kStatusQuery, kClearFault, kSaveSettings.
constexpr Frame pack(Type type, uint8_t sequence) {
  return Packer(type, sequence).frame();
}

constexpr Frame pack(const Hello& m, uint8_t sequence) {
  return Packer(Type::kHello, sequence).u8(m.protocol_version).u16(m.session).frame();
}
constexpr bool unpack(const Frame& frame, Hello& m) {
  if (!is(frame, Type::kHello, 3)) return false;
  Unpacker in(frame);
  m.protocol_version = in.u8();
  m.session = in.u16();
  return true;
}

constexpr Frame pack(const Command& m, uint8_t sequence) {
  return Packer(Type::kCommand, sequence).u8(m.m_code).i32(m.argument).frame();
}
constexpr bool unpack(const Frame& frame, Command& m) {
  if (!is(frame, Type::kCommand, 5)) return false;
  Unpacker in(frame);
  m.m_code = in.u8();
  m.argument = in.i32();
  return true;
}

constexpr Frame pack(const GetSetting& m, uint8_t sequence) {
  return Packer(Type::kGetSetting, sequence).u8(static_cast<uint8_t>(m.id)).frame();
}
constexpr bool unpack(const Frame& frame, GetSetting& m) {
  if (!is(frame, Type::kGetSetting, 1)) return false;
  m.id = static_cast<Setting>(frame.payload[0]);
  return true;
}

constexpr Frame pack(const SetSetting& m, uint8_t sequence) {
  return Packer(Type::kSetSetting, sequence).u8(static_cast<uint8_t>(m.id)).i32(m.value).frame();
}
constexpr bool unpack(const Frame& frame, SetSetting& m) {
  if (!is(frame, Type::kSetSetting, 5)) return false;
  Unpacker in(frame);
  m.id = static_cast<Setting>(in.u8());
  m.value = in.i32();
  return true;
}

constexpr Frame pack(const SettingValue& m, uint8_t sequence) {
  return Packer(Type::kSettingValue, sequence).u8(static_cast<uint8_t>(m.id)).i32(m.value).frame();
}
constexpr bool unpack(const Frame& frame, SettingValue& m) {
  if (!is(frame, Type::kSettingValue, 5)) return false;
  Unpacker in(frame);
  m.id = static_cast<Setting>(in.u8());
  m.value = in.i32();
  return true;
}

constexpr Frame pack(const Banner& m, uint8_t sequence) {
  return Packer(Type::kBanner, sequence)
      .u8(m.protocol_version)
      .u8(m.version_major)
      .u8(m.version_minor)
      .u8(m.version_patch)
      .u8(m.reset_cause)
      .u16(m.config_hash)
      .u16(m.session)
      .u8(static_cast<uint8_t>(m.state))
      .u8(static_cast<uint8_t>(m.fault))
      .frame();
}
constexpr bool unpack(const Frame& frame, Banner& m) {
  if (!is(frame, Type::kBanner, 11)) return false;
  Unpacker in(frame);
  m.protocol_version = in.u8();
  m.version_major = in.u8();
  m.version_minor = in.u8();
  m.version_patch = in.u8();
  m.reset_cause = in.u8();
  m.config_hash = in.u16();
  m.session = in.u16();
  m.state = static_cast<State>(in.u8());
  m.fault = static_cast<Fault>(in.u8());
  return true;
}

constexpr Frame pack(const Ack& m, uint8_t sequence) {
  return Packer(Type::kAck, sequence)
      .u8(static_cast<uint8_t>(m.reason))
      .u8(static_cast<uint8_t>(m.state))
      .frame();
}
constexpr bool unpack(const Frame& frame, Ack& m) {
  if (!is(frame, Type::kAck, 2)) return false;
  m.reason = static_cast<Reason>(frame.payload[0]);
  m.state = static_cast<State>(frame.payload[1]);
  return true;
}

constexpr Frame pack(const Done& m, uint8_t sequence) {
  return Packer(Type::kDone, sequence)
      .u8(static_cast<uint8_t>(m.reason))
      .u8(static_cast<uint8_t>(m.state))
      .i32(m.position)
      .frame();
}
constexpr bool unpack(const Frame& frame, Done& m) {
  if (!is(frame, Type::kDone, 6)) return false;
  Unpacker in(frame);
  m.reason = static_cast<Reason>(in.u8());
  m.state = static_cast<State>(in.u8());
  m.position = in.i32();
  return true;
}

constexpr Frame pack(const Beat& m, uint8_t sequence) {
  return Packer(Type::kBeat, sequence)
      .u8(static_cast<uint8_t>(m.state))
      .u8(static_cast<uint8_t>(m.fault))
      .frame();
}
constexpr bool unpack(const Frame& frame, Beat& m) {
  if (!is(frame, Type::kBeat, 2)) return false;
  m.state = static_cast<State>(frame.payload[0]);
  m.fault = static_cast<Fault>(frame.payload[1]);
  return true;
}

constexpr Frame pack(const FaultReport& m, uint8_t sequence) {
  return Packer(Type::kFault, sequence)
      .u8(static_cast<uint8_t>(m.fault))
      .u8(static_cast<uint8_t>(m.state_before))
      .i16(m.temperature)
      .i32(m.position)
      .frame();
}
constexpr bool unpack(const Frame& frame, FaultReport& m) {
  if (!is(frame, Type::kFault, 8)) return false;
  Unpacker in(frame);
  m.fault = static_cast<Fault>(in.u8());
  m.state_before = static_cast<State>(in.u8());
  m.temperature = in.i16();
  m.position = in.i32();
  return true;
}

constexpr Frame pack(const Status& m, uint8_t sequence) {
  return Packer(Type::kStatus, sequence)
      .u8(static_cast<uint8_t>(m.state))
      .u8(static_cast<uint8_t>(m.fault))
      .u8(m.flags)
      .i16(m.temperature)
      .i16(m.target)
      .i32(m.position)
      .i32(m.retracted)
      .i32(m.speed)
      .u8(m.last_sequence)
      .u8(static_cast<uint8_t>(m.last_result))
      .u32(m.uptime)
      .frame();
}
constexpr bool unpack(const Frame& frame, Status& m) {
  if (!is(frame, Type::kStatus, 25)) return false;
  Unpacker in(frame);
  m.state = static_cast<State>(in.u8());
  m.fault = static_cast<Fault>(in.u8());
  m.flags = in.u8();
  m.temperature = in.i16();
  m.target = in.i16();
  m.position = in.i32();
  m.retracted = in.i32();
  m.speed = in.i32();
  m.last_sequence = in.u8();
  m.last_result = static_cast<Reason>(in.u8());
  m.uptime = in.u32();
  return true;
}

}  // namespace wire
}  // namespace reforge
