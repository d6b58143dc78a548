// What the verifier found wrong: each with line, block, place, depth and a sentence.
//
// Every fault is counted; the worst of each kind is kept. A finding is a fault: a program with any
// does not pass. Places are in the part frame, mm.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "planner/geometry/mesh.h"

namespace reforge::verify {

enum class Fault {
  kNotUnderstood,  // the reader refused a line; nothing behind it was simulated
  kLineTooLong,    // likewise
  kHeader,         // the header speaks of another rig, stock or mode
  kStart,          // moves near the part from a place that was never said
  kAxisLimit,      // beyond an axis' travel
  kFeedRange,      // faster than the axes or the tool may go, or hardly moving
  kSpindleRange,
  kRotaryNotAlone,     // a rotary word beside others, or at feed
  kRotaryLow,          // rotary axes turn with the tools below the clear height
  kModuleLow,          // M70 or M71 below the clear height
  kModuleState,        // M70-M75 in an order the extruder refuses
  kSpindleOff,         // cutting with the spindle stopped
  kSpindleOn,          // printing with the spindle turning
  kRapidInMaterial,    // the cutter at G0 through material
  kGouge,              // the cutter in what is to be kept
  kCutterCollision,    // the cutter in table or fixture, or in anything while printing
  kHolderCollision,    // shank, collet or spindle in stock, table or fixture
  kNozzleCollision,    // the nozzle's body, deployed
  kIdleCollision,      // the parked nozzle
  kNozzleDrag,         // the nozzle's mouth through material
  kBelowBase,          // the tool tip below the base the part stands on
  kExtrusionOnTravel,  // G0 or a rotary move while extruding
  kExtrusionMissing,   // feed moves with the module open and no extrusion, longer than a coast
  kExtrusionRate,      // the bead would be far from its width
  kNotRetracted,       // a long travel or a rotary move with filament at the mouth
  kUnsupported,        // a bead with nothing beneath it
  kDepositOutside,     // a bead beyond the part
  kEndState,           // the end with heater, spindle or extrusion on; or no end
  kDeviation,          // the finished part lacks material it should have
  kNotPrinted,         // a good part of what was to be added has no bead near
  kLeftOver,           // a lump that was to be milled away is still there
  kStarvation,         // segments shorter in time than the link can carry
  kNotAsPlanned,       // a block whose lines do not do what its comment says was planned
};
constexpr std::size_t kFaults = static_cast<std::size_t>(Fault::kNotAsPlanned) + 1;

std::string_view name_of(Fault fault);  // "rapid_in_material"

struct Finding {
  Fault fault = Fault::kNotUnderstood;
  std::size_t line = 0;  // 0: of the whole
  int block = 0;         // 0: before the first
  Vec3 position = Vec3::Zero();
  double depth_mm = 0;  // how far in, over, or beyond; 0 where there is no such thing
  std::string sentence;
};

class Findings {
 public:
  struct Kind {
    std::uint64_t count = 0;
    Finding worst;
  };

  // Counts a fault; `sentence()` is only called when it is the worst of its kind so far.
  template <typename Sentence>
  void add(Fault fault, std::size_t line, int block, const Vec3& position, double depth_mm,
           const Sentence& sentence) {
    Kind& kind = kinds_[static_cast<std::size_t>(fault)];
    if (kind.count++ == 0 || depth_mm > kind.worst.depth_mm) {
      kind.worst = {fault, line, block, position, depth_mm, sentence()};
    }
  }

  const Kind& of(Fault fault) const { return kinds_[static_cast<std::size_t>(fault)]; }
  std::uint64_t total() const {
    std::uint64_t sum = 0;
    for (const Kind& kind : kinds_) sum += kind.count;
    return sum;
  }

 private:
  std::array<Kind, kFaults> kinds_;
};

// "12.34": millimetres in sentences.
std::string millimetres(double value);

}  // namespace reforge::verify
