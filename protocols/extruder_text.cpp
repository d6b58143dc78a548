#include "protocols/extruder_text.h"

#include <array>
#include <cstddef>

namespace reforge {
namespace {

struct Text {
  std::string_view name;
  std::string_view sentence;
};

// Tables stand in the order of the codes; their sizes are the enums'.
constexpr std::array<Text, wire::kStateCount> kStates = {{
    {"closed", "The extruder module is closed and its heater is off."},
    {"opening", "The extruder module is opening and heating up."},
    {"ready", "The extruder is open and at temperature; the filament stands still."},
    {"restoring", "The extruder is pushing the retracted filament back."},
    {"extruding", "The extruder is extruding."},
    {"stopping", "The extruder is ramping down to a stop."},
    {"retracting", "The extruder is retracting filament."},
    {"closing", "The extruder module is closing; its heater is off."},
    {"standby", "The extruder module is open but unheated; open it again (M70) or close it (M71)."},
    {"fault", "The extruder has latched a fault: heat and extrusion are off."},
    {"retracted", "The filament is retracted; end the retraction (M75) before extruding."},
}};

constexpr std::array<Text, wire::kReasonCount> kReasons = {{
    {"none", "Accepted."},
    {"fault latched", "The extruder has latched a fault; remove its cause and clear it first."},
    {"no hello", "The extruder board has been reset and waits for a hello; nothing was executed."},
    {"stale", "An order older than the last one arrived and was not executed."},
    {"busy", "Another order is still under way."},
    {"unknown command", "The extruder board does not know this command; compare the versions."},
    {"bad argument", "The argument is outside the extruder board's limits."},
    {"not open", "The extruder is not open and ready; open it (M70) first."},
    {"too cold", "The nozzle is below the minimum temperature for moving filament."},
    {"no filament", "The filament sensor sees no filament; load some."},
    {"extrusion on", "Extrusion is on; switch it off (M73) first."},
    {"retraction on", "Retraction is on; end it (M75) first."},
    {"not idle", "Settings can only be changed while the extruder module is closed."},
    {"unknown setting", "The extruder board has no such setting; compare the versions."},
    {"fault persists", "The cause of the fault is still there; repair it before clearing."},
    {"superseded", "The order was ended by a later M71 or M73."},
    {"faulted", "The order was ended by a fault."},
    {"wrong version", "The extruder board speaks another version of the protocol; flash it anew."},
    {"pending", "The order is still under way."},
    {"in-stream only",
     "The extruder is wired to the CNC's outputs and takes no M-codes by its port."},
    {"save failed", "The settings could not be written to the board's memory."},
}};

constexpr std::array<Text, wire::kFaultCount> kFaults = {{
    {"none", "No fault."},
    {"sensor open", "The temperature sensor is disconnected; check its plug and wires."},
    {"sensor short", "The temperature sensor is short-circuited; check its wires."},
    {"over temperature", "The nozzle is hotter than allowed; check the heater's switch."},
    {"no rise", "The heater is on but the nozzle does not warm up; check heater and sensor seat."},
    {"runaway",
     "The nozzle has stayed too far below its temperature; check heater, sensor and fan."},
    {"silence", "The host fell silent while the extruder was open; heat was switched off."},
    {"extrusion silence",
     "The host fell silent while extruding; extrusion and heat were switched off."},
    {"filament out", "The filament ran out while extruding; load some and inspect the part."},
    {"input conflict", "The CNC asked for extrusion and retraction at once; check the wiring."},
    {"cnc stopped", "The CNC stopped running while extruding; extrusion was switched off."},
    {"internal",
     "The extruder firmware found an inconsistency in itself; report it with the journal."},
    {"heater timeout", "The nozzle did not reach its temperature in time; check the heater."},
    {"refused input",
     "The CNC asked for what the extruder could not do then; check the program's waits."},
}};

constexpr std::array<std::string_view, wire::kSettingCount> kSettings = {{
    "steps_per_metre",
    "filament_speed_um_per_s",
    "acceleration_um_per_s2",
    "retract_length_um",
    "retract_speed_um_per_s",
    "target_temperature_tenths_c",
    "minimum_temperature_tenths_c",
    "maximum_temperature_tenths_c",
    "heater_fitted",
    "silence_ms",
    "extrusion_silence_ms",
    "module_travel_ms",
    "servo_open_us",
    "servo_closed_us",
    "filament_sensor",
    "reverse_direction",
    "pid_p",
    "pid_i",
    "pid_d",
    "rise_temperature_tenths_c",
    "rise_time_ms",
    "runaway_temperature_tenths_c",
    "runaway_time_ms",
    "heat_up_time_ms",
    "in_stream",
    "text_silence_ms",
}};

constexpr Text kUnknown = {"unknown code",
                           "The extruder board sent a code this version does not know."};

template <std::size_t N, typename Code>
const Text& look_up(const std::array<Text, N>& table, Code code) {
  const auto index = static_cast<std::size_t>(code);
  return index < N ? table[index] : kUnknown;
}

}  // namespace

std::string_view name_of(wire::State state) {
  return look_up(kStates, state).name;
}
std::string_view sentence_of(wire::State state) {
  return look_up(kStates, state).sentence;
}
std::string_view name_of(wire::Reason reason) {
  return look_up(kReasons, reason).name;
}
std::string_view sentence_of(wire::Reason reason) {
  return look_up(kReasons, reason).sentence;
}
std::string_view name_of(wire::Fault fault) {
  return look_up(kFaults, fault).name;
}
std::string_view sentence_of(wire::Fault fault) {
  return look_up(kFaults, fault).sentence;
}

std::string_view name_of(wire::Setting setting) {
  const auto index = static_cast<std::size_t>(setting);
  return index < kSettings.size() ? kSettings[index] : kUnknown.name;
}

std::string_view reset_cause_text(uint8_t reset_cause) {
  if (reset_cause & wire::kResetWatchdog) return "watchdog";
  if (reset_cause & wire::kResetBrownOut) return "brown-out";
  if (reset_cause & wire::kResetExternal) return "button or port opened";
  if (reset_cause & wire::kResetPowerOn) return "power on";
  return "unknown";
}

}  // namespace reforge
