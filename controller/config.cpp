#include "controller/config.h"

#include <grp.h>
#include <pwd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

namespace reforge {
namespace {

using nlohmann::json;

constexpr const char* kFormat = "reforged 1";

// Thrown and caught inside this file only.
struct Fault {
  Code code;
  std::string sentence;
};

// One object of the file: remembers which keys were asked for, so that the rest are unknown.
class Section {
 public:
  Section(const json& object, std::string file, std::string path)
      : object_(object), file_(std::move(file)), path_(std::move(path)) {
    if (!object_.is_object()) fail(Code::kMalformed, "", "must be an object");
  }

  Section child(const char* key) const { return {find(key), file_, dotted(key)}; }

  std::string text(const char* key) const {
    const json& value = find(key);
    if (!value.is_string() || value.get_ref<const std::string&>().empty()) {
      fail(Code::kMalformed, key, "must be a string that is not empty");
    }
    return value.get<std::string>();
  }

  std::filesystem::path path(const char* key) const {
    std::filesystem::path value = text(key);
    if (!value.is_absolute()) fail(Code::kMalformed, key, "must be an absolute path");
    return value;
  }

  std::int64_t number(const char* key, std::int64_t min, std::int64_t max) const {
    const json& value = find(key);
    if (!value.is_number_integer()) fail(Code::kMalformed, key, "must be a whole number");
    const bool huge =
        value.is_number_unsigned() && value.get<std::uint64_t>() > static_cast<std::uint64_t>(max);
    if (huge || value.get<std::int64_t>() < min || value.get<std::int64_t>() > max) {
      fail(Code::kOutOfRange, key,
           "must be from " + std::to_string(min) + " to " + std::to_string(max));
    }
    return value.get<std::int64_t>();
  }

  std::vector<std::string> texts(const char* key) const {
    const json& value = find(key);
    std::vector<std::string> out;
    if (value.is_array()) {
      for (const json& item : value) {
        if (!item.is_string()) fail(Code::kMalformed, key, "must be a list of strings");
        out.push_back(item.get<std::string>());
      }
      return out;
    }
    fail(Code::kMalformed, key, "must be a list of strings");
  }

  const json& find(const char* key) const {
    asked_.insert(key);
    const auto found = object_.find(key);
    if (found == object_.end()) fail(Code::kMalformed, key, "is missing");
    return *found;
  }

  void no_other_keys() const {
    for (const auto& [key, value] : object_.items()) {
      if (!asked_.contains(key)) fail(Code::kUnknownKey, key.c_str(), "is a key nobody reads");
    }
  }

  [[noreturn]] void fail(Code code, const char* key, const std::string& what) const {
    throw Fault{code, file_ + ": \"" + dotted(key) + "\" " + what + "."};
  }

 private:
  std::string dotted(const std::string& key) const {
    return path_.empty() ? key : key.empty() ? path_ : path_ + "." + key;
  }

  const json& object_;
  std::string file_;
  std::string path_;
  mutable std::set<std::string> asked_;
};

PortConfig port(const Section& in) {
  PortConfig out;
  out.path = in.path("path");
  const std::string kind = in.text("kind");
  if (kind == "serial") {
    out.kind = PortKind::kSerial;
  } else if (kind == "virtual") {
    out.kind = PortKind::kVirtual;
  } else {
    in.fail(Code::kMalformed, "kind", "must be \"serial\" or \"virtual\"");
  }
  in.no_other_keys();
  return out;
}

RoleMembers members(const Section& in) {
  RoleMembers out;
  for (const std::string& name : in.texts("users")) {
    const passwd* entry = getpwnam(name.c_str());
    if (entry == nullptr) in.fail(Code::kMalformed, "users", "names no user \"" + name + "\"");
    out.users.push_back(entry->pw_uid);
  }
  for (const std::string& name : in.texts("groups")) {
    const group* entry = getgrnam(name.c_str());
    if (entry == nullptr) in.fail(Code::kMalformed, "groups", "names no group \"" + name + "\"");
    out.groups.push_back(entry->gr_gid);
  }
  in.no_other_keys();
  return out;
}

VerifierConfig verifier(const Section& in) {
  VerifierConfig out;
  out.command = in.texts("command");
  if (out.command.empty()) in.fail(Code::kMalformed, "command", "must name a program");
  if (!in.find("memory_mib").is_null()) out.memory_mib = in.number("memory_mib", 64, 1 << 20);
  out.seconds = in.number("seconds", 1, 24 * 3600);
  in.no_other_keys();
  return out;
}

DaemonConfig parse(const json& document, const std::string& file) {
  const Section top(document, file, "");
  if (top.text("format") != kFormat) {
    top.fail(Code::kWrongVersion, "format", std::string("must be \"") + kFormat + "\"");
  }
  DaemonConfig out;
  out.socket = top.path("socket");
  // sockaddr_un holds no more than 107 bytes of path.
  if (out.socket.native().size() > 107) {
    top.fail(Code::kOutOfRange, "socket", "is longer than the 107 bytes a socket's path may have");
  }
  out.state_directory = top.path("state_directory");
  out.rig = top.path("rig");
  if (top.text("clock") != "monotonic") out.clock = top.path("clock");
  const Section ports = top.child("ports");
  out.cnc = port(ports.child("cnc"));
  out.extruder = port(ports.child("extruder"));
  ports.no_other_keys();
  const Section roles = top.child("roles");
  out.observe = members(roles.child("observe"));
  out.operate = members(roles.child("operate"));
  out.administer = members(roles.child("administer"));
  roles.no_other_keys();
  out.verifier = verifier(top.child("verifier"));
  const Section limits = top.child("limits");
  out.clients_max = limits.number("clients", 1, 10000);
  out.waiting_jobs_max = limits.number("waiting_jobs", 1, 100000);
  limits.no_other_keys();
  top.no_other_keys();
  if (out.clock &&
      (out.cnc.kind != PortKind::kVirtual || out.extruder.kind != PortKind::kVirtual)) {
    top.fail(Code::kMalformed, "clock",
             "is a virtual rig's, but a port is real: a real machine takes only \"monotonic\"");
  }
  return out;
}

}  // namespace

Result<DaemonConfig> parse_config(std::string_view text, const std::string& name_for_errors) {
  try {
    return parse(json::parse(text), name_for_errors);
  } catch (const Fault& fault) {
    return Error{fault.code, fault.sentence};
  } catch (const json::exception& e) {
    return Error{Code::kMalformed, name_for_errors + ": " + e.what()};
  }
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
