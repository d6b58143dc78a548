// What the shop tells the daemon: where its socket, state, rig file and ports are, and who may do
// what.
//
// One JSON file, read once at start. Unknown keys, missing keys and values out of range are errors
// that name the file and the key. Format: FORMATS.md, "Daemon configuration".
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/result.h"

namespace reforge {

// A virtual port is a pseudo-terminal of the virtual rig: the only kind that runs without a
// commissioned rig file (a simulated backend apart), and the only kind that runs jobs certified in
// paper mode.
enum class PortKind { kSerial, kVirtual };

// What stands behind the links: the ports, or a CNC and an extruder board simulated in process
// (io/simulated_rig.h), for trying out what is around the machine.
enum class Backend { kPorts, kSimulated };

struct PortConfig {
  std::filesystem::path path;
  PortKind kind = PortKind::kSerial;
};

// Users and groups by number; a member of a role's users or groups (supplementary ones too) has it.
struct RoleMembers {
  std::vector<uid_t> users;
  std::vector<gid_t> groups;
};

struct VerifierConfig {
  std::vector<std::string> command;  // the job's folder is appended
  std::optional<int> memory_mib;     // absent: no limit
  std::optional<int> seconds;        // of processor time, and four times that of wall time
};

struct DaemonConfig {
  std::filesystem::path socket;
  std::filesystem::path state_directory;
  std::filesystem::path rig;
  std::optional<std::filesystem::path> clock;  // socket of a virtual rig's clock; absent: monotonic
  Backend backend = Backend::kPorts;
  PortConfig cnc;  // with a simulated backend not opened
  PortConfig extruder;
  // By role. Root and the daemon's own user administer whatever is written here.
  RoleMembers observe, operate, administer;
  VerifierConfig verifier;
  int clients_max = 0;
  int waiting_jobs_max = 0;

  bool virtual_ports() const {
    return backend == Backend::kSimulated ||
           (cnc.kind == PortKind::kVirtual && extruder.kind == PortKind::kVirtual);
  }
};

Result<DaemonConfig> read_config(const std::filesystem::path& file);
Result<DaemonConfig> parse_config(std::string_view text, const std::string& name_for_errors);

}  // namespace reforge
