#include "controller/reports.h"

#include <unistd.h>

#include <algorithm>

#include "protocols/extruder_text.h"

namespace reforge {
namespace {

bool has(const RoleMembers& role, uid_t user, const std::vector<gid_t>& groups) {
  if (std::find(role.users.begin(), role.users.end(), user) != role.users.end()) return true;
  return std::any_of(groups.begin(), groups.end(), [&](gid_t group) {
    return std::find(role.groups.begin(), role.groups.end(), group) != role.groups.end();
  });
}

std::optional<double> degrees(std::int16_t tenths) {
  if (tenths == wire::kTemperatureUnknown) return std::nullopt;
  return tenths / 10.0;
}

}  // namespace

api::RigReport report_of(const RigSnapshot& snapshot) {
  api::RigReport out;
  out.state = name(snapshot.state);
  out.reason = snapshot.sentence;
  out.cnc.up = snapshot.cnc_open;
  out.extruder.up = snapshot.extruder_open;
  if (snapshot.cnc) out.cnc.state = name(snapshot.cnc->state);
  out.cnc.detail = snapshot.cnc_version;
  if (snapshot.extruder) {
    const wire::Status& extruder = *snapshot.extruder;
    out.extruder.state = name_of(extruder.state);
    if (extruder.fault != wire::Fault::kNone) out.extruder.detail = sentence_of(extruder.fault);
    out.temperature_c = degrees(extruder.temperature);
    out.target_c = degrees(extruder.target);
  }
  return out;
}

api::Progress progress_of(const api::JobReport& job, const RigSnapshot& snapshot,
                          double machine_s) {
  api::Progress out;
  out.job = job.job;
  out.state = job.state;
  out.acknowledged = job.acknowledged;
  out.lines = job.lines;
  out.toggles = snapshot.relayed;
  out.machine_s = machine_s;
  if (snapshot.extruder) out.temperature_c = degrees(snapshot.extruder->temperature);
  return out;
}

RoleOf role_mapping(const DaemonConfig& config) {
  return [observe = config.observe, operate = config.operate, administer = config.administer](
             uid_t user, const std::vector<gid_t>& groups) -> std::optional<api::Role> {
    if (user == 0 || user == geteuid() || has(administer, user, groups)) {
      return api::Role::kAdminister;
    }
    if (has(operate, user, groups)) return api::Role::kOperate;
    if (has(observe, user, groups)) return api::Role::kObserve;
    return std::nullopt;
  };
}

void record(Journal& journal, const Call& call, const std::string& outcome) {
  journal.write(
      journal::Act{call.peer.who, api::name_of(call.method), call.params.dump(), outcome});
}

}  // namespace reforge
