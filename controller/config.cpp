#include "controller/config.h"

#include <grp.h>
#include <pwd.h>

#include <fstream>
#include <sstream>

#include "protocols/strict_json.h"

namespace reforge {
namespace {

constexpr const char* kFormat = "reforged 1";
constexpr std::size_t kSocketPathMax = 107;  // sockaddr_un holds no more

std::filesystem::path absolute_path(StrictJson& document, StrictObject& in, const char* key) {
  std::filesystem::path value = in.text(key);
  if (!value.is_absolute()) {
    document.fail(Code::kMalformed, in.dotted(key), "must be an absolute path");
  }
  return value;
}

PortConfig port(StrictJson& document, StrictObject in) {
  PortConfig out;
  out.path = absolute_path(document, in, "path");
  out.kind = in.one_of("kind", {"serial", "virtual"}) == "virtual" ? PortKind::kVirtual
                                                                   : PortKind::kSerial;
  in.close();
  return out;
}

RoleMembers members(StrictJson& document, StrictObject in) {
  RoleMembers out;
  for (const std::string& name : in.texts("users")) {
    if (const passwd* entry = getpwnam(name.c_str())) {
      out.users.push_back(entry->pw_uid);
    } else {
      document.fail(Code::kMalformed, in.dotted("users"), "names no user: \"" + name + "\"");
    }
  }
  for (const std::string& name : in.texts("groups")) {
    if (const group* entry = getgrnam(name.c_str())) {
      out.groups.push_back(entry->gr_gid);
    } else {
      document.fail(Code::kMalformed, in.dotted("groups"), "names no group: \"" + name + "\"");
    }
  }
  in.close();
  return out;
}

VerifierConfig verifier(StrictJson& document, StrictObject in) {
  VerifierConfig out;
  out.command = in.texts("command");
  if (out.command.empty() || !std::filesystem::path(out.command.front()).is_absolute()) {
    document.fail(Code::kMalformed, in.dotted("command"),
                  "must begin with the absolute path of a program");
  }
  if (auto limits = in.object_or_null("limits")) {
    out.memory_mib = limits->integer("memory_mib", 64, 1 << 20);
    out.seconds = limits->integer("seconds", 1, 24 * 3600);
    limits->close();
  }
  in.close();
  return out;
}

}  // namespace

Result<DaemonConfig> parse_config(std::string_view text, const std::string& name_for_errors) {
  StrictJson document(text, name_for_errors);
  StrictObject root = document.root();
  DaemonConfig out;
  if (root.text("format") != kFormat) {
    document.fail(Code::kWrongVersion, "format", std::string("must be \"") + kFormat + "\"");
  }
  out.socket = absolute_path(document, root, "socket");
  if (out.socket.native().size() > kSocketPathMax) {
    document.fail(Code::kOutOfRange, "socket", "must have no more than 107 bytes");
  }
  out.state_directory = absolute_path(document, root, "state_directory");
  out.rig = absolute_path(document, root, "rig");
  if (root.text("clock") != "monotonic") out.clock = absolute_path(document, root, "clock");
  if (root.contains("backend")) {
    out.backend = root.one_of("backend", {"ports", "simulated"}) == "simulated"
                      ? Backend::kSimulated
                      : Backend::kPorts;
  }
  StrictObject ports = root.object("ports");
  out.cnc = port(document, ports.object("cnc"));
  out.extruder = port(document, ports.object("extruder"));
  ports.close();
  StrictObject roles = root.object("roles");
  out.observe = members(document, roles.object("observe"));
  out.operate = members(document, roles.object("operate"));
  out.administer = members(document, roles.object("administer"));
  roles.close();
  out.verifier = verifier(document, root.object("verifier"));
  StrictObject limits = root.object("limits");
  out.clients_max = limits.integer("clients", 1, 10000);
  out.waiting_jobs_max = limits.integer("waiting_jobs", 1, 100000);
  limits.close();
  root.close();
  if (out.clock && out.backend == Backend::kSimulated) {
    document.fail(Code::kMalformed, "clock",
                  "is a virtual rig's while the backend is simulated: that takes \"monotonic\"");
  }
  if (out.clock && !out.virtual_ports()) {
    document.fail(Code::kMalformed, "clock",
                  "is a virtual rig's while a port is real: a real machine takes \"monotonic\"");
  }
  if (document.error()) return *document.error();
  return out;
}

Result<DaemonConfig> read_config(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  if (!in || !(text << in.rdbuf())) {
    return Error{Code::kUnreadable, file.string() + ": the configuration cannot be read."};
  }
  return parse_config(text.str(), file.string());
}

}  // namespace reforge
