// What the extruder was told to push against what its STEP pin did, from a rig's trace.
//
// Between M72 and M73 the filament should advance by rate × time; M74 takes a length back, and the
// next M72 restores it before it is acknowledged. Both sides are summed over the whole trace, in
// millimetres of filament. The ramps at both ends of a bead are not modelled: at the filament
// speeds of this rig (under 1 mm/s) they are below a step.
#pragma once

#include <filesystem>

#include "protocols/result.h"

namespace reforge {

struct FilamentAccount {
  int beads = 0;           // M72 … M73
  int retractions = 0;     // M74
  double ordered_mm = 0;   // sum of rate × time
  double extruded_mm = 0;  // steps counted between the same instants
  double retract_ordered_mm =
      0;               // retractions × the length the program asks for, less what was restored
  double net_mm = 0;   // steps counted over the whole trace
  double seconds = 0;  // time of the last record

  // Relative difference of the net count from what was ordered, retraction included.
  double error() const;
};

// `steps_per_mm` and `retract_mm` are the rig's.
Result<FilamentAccount> read_filament_account(const std::filesystem::path& trace,
                                              double steps_per_mm, double retract_mm);

}  // namespace reforge
