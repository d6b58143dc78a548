// What must hold before the first line of a job is sent: pure, each refusal a sentence.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "controller/core/job.h"
#include "controller/devices/cnc_session.h"
#include "protocols/extruder_wire.h"
#include "protocols/rig.h"

namespace reforge {

constexpr double kG54ToleranceMm = 0.05;

// Before anything is asked of a device: rig commissioned or ports virtual; a paper certificate on
// virtual ports only.
std::vector<std::string> start_refusals(const RigDescription& rig, bool ports_are_virtual,
                                        Mode mode);

// With the devices' answers: CNC Idle, G54 within 0.05 mm of the header's, extruder closed, well
// and permitting the CNC to run. A job that recovers another may find the module open, as the other
// left it, unless filament moves.
std::vector<std::string> readiness_refusals(const CncFacts& cnc,
                                            const std::optional<wire::Status>& extruder,
                                            const Point<MachineFrame>& g54_of_program,
                                            bool recovers = false);

// Identity: the axes the controller names are those of the rig file.
std::optional<std::string> identity_refusal(const CncFacts& cnc, const RigDescription& rig);

}  // namespace reforge
