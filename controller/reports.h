// What operators are told, from what the core knows; and who they are, from what the config says.
#pragma once

#include <string>

#include "controller/config.h"
#include "controller/core/sequencer.h"
#include "controller/io/journal.h"
#include "controller/io/operator_server.h"
#include "protocols/operator_api.h"

namespace reforge {

// Without name, paths, link troubles and clock, which the core does not know.
api::RigReport report_of(const RigSnapshot& snapshot);

api::Progress progress_of(const api::JobReport& job, const RigSnapshot& snapshot, double machine_s);

// The highest role any of the peer's memberships gives; root and our own user administer.
RoleOf role_mapping(const DaemonConfig& config);

// A call that changes something, and how it ended, for the journal.
void record(Journal& journal, const Call& call, const std::string& outcome);

}  // namespace reforge
