// Where filament really came out against where the program wants it, bead by bead: the rig's trace
// (FORMATS.md, "Rig trace") held against the program's M72 ... M73.
//
// The n-th `extrude_on` of the trace is the n-th M72 of the program. A bead begins where the axes
// stood when filament first went forward after M72, and ends where they stood at its last step;
// between, at each `flow` record, the filament that has come out says how far along the bead the
// nozzle should be. Places in G54, mm (the programmed point; the nozzle's offset is the same on
// both sides). Limits: a job that was interrupted and resumed repeats or leaves out beads, and is
// refused by their number; in-stream rigs, whose orders name no speed, take the program's.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

struct BeadComparison {
  std::size_t line = 0;       // of M72 in the program
  double length_mm = 0;       // of its path
  double start_error_mm = 0;  // distance of the first filament from the bead's start
  double end_error_mm = 0;    // of the last filament from its end
  double lag_mm = 0;          // largest distance along the bead between nozzle and filament
  double planned_mm = 0;      // filament: rate x time at the programmed feed, priming included
  double counted_mm = 0;      // on the STEP pin
};

struct TraceComparison {
  std::vector<BeadComparison> beads;
  std::size_t program_beads = 0, trace_beads = 0;
  bool flow_recorded = false;  // otherwise lag_mm is 0 and says nothing

  const BeadComparison* worst_start() const;
  const BeadComparison* worst_end() const;
  // As many beads, each begun and ended within `tolerance_mm`.
  bool good(double tolerance_mm) const;
};

Result<TraceComparison> compare_trace(const std::filesystem::path& program,
                                      const RigDescription& rig,
                                      const std::filesystem::path& trace);

}  // namespace reforge
