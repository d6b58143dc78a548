#include "protocols/operator_api.h"

#include <algorithm>
#include <array>

namespace reforge::api {
namespace {

using nlohmann::json;

struct MethodRow {
  Method method;
  const char* name;
  Role role;
};
constexpr std::array<MethodRow, kMethodCount> kMethods = {{
    {Method::kHello, "hello", Role::kObserve},
    {Method::kSubmit, "submit", Role::kOperate},
    {Method::kConfirm, "confirm", Role::kOperate},
    {Method::kAdmit, "admit", Role::kAdminister},
    {Method::kRecover, "recover", Role::kOperate},
    {Method::kReheat, "reheat", Role::kOperate},
    {Method::kStart, "start", Role::kOperate},
    {Method::kHold, "hold", Role::kOperate},
    {Method::kResume, "resume", Role::kOperate},
    {Method::kAbort, "abort", Role::kOperate},
    {Method::kEmergency, "emergency", Role::kOperate},
    {Method::kClear, "clear", Role::kOperate},
    {Method::kStatus, "status", Role::kObserve},
    {Method::kJobs, "jobs", Role::kObserve},
    {Method::kSubscribe, "subscribe", Role::kObserve},
    {Method::kShutdown, "shutdown", Role::kAdminister},
}};

constexpr std::array<const char*, kJobStateCount> kJobStates = {
    "queued", "verifying", "ready", "running", "held", "done", "failed", "aborted", "interrupted"};

constexpr bool in_order() {
  for (int i = 0; i < kMethodCount; ++i) {
    if (static_cast<int>(kMethods[static_cast<std::size_t>(i)].method) != i) return false;
  }
  return true;
}
static_assert(in_order());

json optional_number(const std::optional<double>& value) {
  return value ? json(*value) : json(nullptr);
}

// Invalid UTF-8 (a device may send anything) must not make a message impossible.
std::string dump(const json& message) {
  return message.dump(-1, ' ', false, json::error_handler_t::replace);
}

json to_json(const LinkReport& link) {
  return {{"up", link.up}, {"path", link.path}, {"state", link.state}, {"detail", link.detail}};
}

}  // namespace

const char* name_of(Role role) {
  switch (role) {
    case Role::kObserve:
      return "observe";
    case Role::kOperate:
      return "operate";
    case Role::kAdminister:
      return "administer";
  }
  return "";
}

const char* name_of(Method method) {
  return kMethods[static_cast<std::size_t>(method)].name;
}

const char* name_of(JobState state) {
  return kJobStates[static_cast<std::size_t>(state)];
}

Role role_needed(Method method) {
  return kMethods[static_cast<std::size_t>(method)].role;
}

std::optional<Method> method_named(std::string_view name) {
  for (const MethodRow& row : kMethods) {
    if (name == row.name) return row.method;
  }
  return std::nullopt;
}

std::optional<JobState> job_state_named(std::string_view name) {
  for (std::size_t i = 0; i < kJobStates.size(); ++i) {
    if (name == kJobStates[i]) return static_cast<JobState>(i);
  }
  return std::nullopt;
}

std::variant<Request, Refusal> parse_request(std::string_view line) {
  const json message = json::parse(line, nullptr, false);
  if (message.is_discarded()) return Refusal{nullptr, {kParseError, "The line is not JSON."}};
  if (!message.is_object()) {
    return Refusal{nullptr,
                   {kInvalidRequest, "A request is one JSON object; batches are not taken."}};
  }
  Request request;
  if (const auto id = message.find("id"); id != message.end()) {
    if (!id->is_number_integer() && !id->is_string() && !id->is_null()) {
      return Refusal{nullptr, {kInvalidRequest, "\"id\" must be a whole number or a string."}};
    }
    request.id = *id;
    request.answered = true;
  }
  const auto version = message.find("jsonrpc");
  if (version == message.end() || *version != "2.0") {
    return Refusal{request.id, {kInvalidRequest, "\"jsonrpc\" must be \"2.0\"."}};
  }
  for (const auto& [key, value] : message.items()) {
    if (key != "jsonrpc" && key != "id" && key != "method" && key != "params") {
      return Refusal{request.id, {kInvalidRequest, "A request has no key \"" + key + "\"."}};
    }
  }
  const auto method = message.find("method");
  if (method == message.end() || !method->is_string()) {
    return Refusal{request.id, {kInvalidRequest, "\"method\" must be a string."}};
  }
  const auto named = method_named(method->get_ref<const std::string&>());
  if (!named) {
    return Refusal{request.id,
                   {kMethodNotFound, "There is no method \"" + method->get<std::string>() + "\"."}};
  }
  request.method = *named;
  request.params = json::object();
  if (const auto params = message.find("params"); params != message.end()) {
    if (!params->is_object()) {
      return Refusal{request.id, {kInvalidParams, "\"params\" must be an object."}};
    }
    request.params = *params;
  }
  return request;
}

void Params::complain(std::string sentence) {
  if (fault_.empty()) fault_ = std::move(sentence);
}

const json* Params::find(const char* key, bool needed) {
  asked_.emplace_back(key);
  const auto found = object_.find(key);
  if (found != object_.end()) return &*found;
  if (needed) complain(std::string("The parameter \"") + key + "\" is missing.");
  return nullptr;
}

std::optional<std::string> Params::optional_text(const char* key, std::size_t bytes_max) {
  const json* value = find(key, false);
  if (value == nullptr) return std::nullopt;
  if (!value->is_string() || value->get_ref<const std::string&>().size() > bytes_max) {
    complain(std::string("The parameter \"") + key + "\" must be a string of at most " +
             std::to_string(bytes_max) + " bytes.");
    return std::nullopt;
  }
  return value->get<std::string>();
}

std::string Params::text(const char* key, std::size_t bytes_max) {
  if (find(key, true) == nullptr) return {};
  return optional_text(key, bytes_max).value_or("");
}

std::optional<std::int64_t> Params::optional_number(const char* key, std::int64_t min,
                                                    std::int64_t max) {
  const json* value = find(key, false);
  if (value == nullptr) return std::nullopt;
  const bool fits = value->is_number_integer() &&
                    !(value->is_number_unsigned() &&
                      value->get<std::uint64_t>() > static_cast<std::uint64_t>(INT64_MAX)) &&
                    value->get<std::int64_t>() >= min && value->get<std::int64_t>() <= max;
  if (!fits) {
    complain(std::string("The parameter \"") + key + "\" must be a whole number from " +
             std::to_string(min) + " to " + std::to_string(max) + ".");
    return std::nullopt;
  }
  return value->get<std::int64_t>();
}

std::optional<double> Params::optional_real(const char* key, double min, double max) {
  const json* value = find(key, false);
  if (value == nullptr) return std::nullopt;
  if (value->is_number() && value->get<double>() >= min && value->get<double>() <= max) {
    return value->get<double>();
  }
  complain(std::string("The parameter \"") + key + "\" must be a number from " + json(min).dump() +
           " to " + json(max).dump() + ".");
  return std::nullopt;
}

std::int64_t Params::number(const char* key, std::int64_t min, std::int64_t max) {
  if (find(key, true) == nullptr) return min;
  return optional_number(key, min, max).value_or(min);
}

std::vector<std::string> Params::texts(const char* key, std::size_t count_max) {
  std::vector<std::string> out;
  const json* value = find(key, false);
  if (value == nullptr) return out;
  const bool fits = value->is_array() && value->size() <= count_max &&
                    std::all_of(value->begin(), value->end(), [](const json& item) {
                      return item.is_string() && item.get_ref<const std::string&>().size() <= 4096;
                    });
  if (fits) return value->get<std::vector<std::string>>();
  complain(std::string("The parameter \"") + key + "\" must be a list of at most " +
           std::to_string(count_max) + " strings.");
  return out;
}

bool Params::flag(const char* key) {
  const json* value = find(key, false);
  if (value == nullptr) return false;
  if (!value->is_boolean()) {
    complain(std::string("The parameter \"") + key + "\" must be true or false.");
    return false;
  }
  return value->get<bool>();
}

const std::string& Params::fault() {
  for (const auto& [key, value] : object_.items()) {
    if (std::find(asked_.begin(), asked_.end(), key) == asked_.end()) {
      complain("There is no parameter \"" + key + "\" here.");
    }
  }
  return fault_;
}

std::string response(const json& id, const json& result) {
  return dump({{"jsonrpc", "2.0"}, {"id", id}, {"result", result}});
}

std::string error_response(const json& id, const Failure& failure) {
  return dump({{"jsonrpc", "2.0"},
               {"id", id},
               {"error", {{"code", failure.code}, {"message", failure.sentence}}}});
}

std::string notification(std::string_view method, const json& params) {
  return dump({{"jsonrpc", "2.0"}, {"method", method}, {"params", params}});
}

json to_json(const JobReport& r) {
  json out = {{"job", r.job},
              {"name", r.name},
              {"state", name_of(r.state)},
              {"reason", r.reason},
              {"mode", r.mode},
              {"submitted_by", r.submitted_by},
              {"submitted_at", r.submitted_at},
              {"changed_at", r.changed_at},
              {"program_sha256", r.program_sha256},
              {"lines", r.lines},
              {"executed", r.executed},
              {"acknowledged", r.acknowledged},
              {"horizon", r.horizon},
              {"toggles", r.toggles},
              {"machine_s", r.machine_s},
              {"estimated_s", r.estimated_s},
              {"uncertain", nullptr},
              {"recovers", r.recovers ? json(*r.recovers) : json(nullptr)},
              {"checklist", json::array()}};
  if (r.uncertain) out["uncertain"] = {{"first", r.uncertain->first}, {"last", r.uncertain->last}};
  for (const ChecklistItem& item : r.checklist) {
    out["checklist"].push_back({{"item", item.item},
                                {"question", item.question},
                                {"by", item.by.empty() ? json(nullptr) : json(item.by)}});
  }
  return out;
}

json to_json(const RigReport& r) {
  return {{"name", r.name},
          {"state", r.state},
          {"reason", r.reason},
          {"cnc", to_json(r.cnc)},
          {"extruder", to_json(r.extruder)},
          {"temperature_c", optional_number(r.temperature_c)},
          {"target_c", optional_number(r.target_c)},
          {"clock_s", r.clock_s}};
}

json to_json(const Progress& p) {
  return {{"job", p.job},
          {"state", name_of(p.state)},
          {"acknowledged", p.acknowledged},
          {"lines", p.lines},
          {"toggles", p.toggles},
          {"machine_s", p.machine_s},
          {"temperature_c", optional_number(p.temperature_c)}};
}

Result<JobReport> job_report(const json& in) {
  try {
    JobReport r;
    r.job = in.at("job").get<std::int64_t>();
    r.name = in.at("name").get<std::string>();
    const auto state = job_state_named(in.at("state").get<std::string>());
    if (!state) return Error{Code::kMalformed, "The daemon names a job state we do not know."};
    r.state = *state;
    r.reason = in.at("reason").get<std::string>();
    r.mode = in.at("mode").get<std::string>();
    r.submitted_by = in.at("submitted_by").get<std::string>();
    r.submitted_at = in.at("submitted_at").get<std::string>();
    r.changed_at = in.at("changed_at").get<std::string>();
    r.program_sha256 = in.at("program_sha256").get<std::string>();
    r.lines = in.at("lines").get<std::int64_t>();
    r.executed = in.at("executed").get<std::int64_t>();
    r.acknowledged = in.at("acknowledged").get<std::int64_t>();
    r.horizon = in.at("horizon").get<std::int64_t>();
    r.toggles = in.at("toggles").get<std::int64_t>();
    r.machine_s = in.at("machine_s").get<double>();
    r.estimated_s = in.at("estimated_s").get<double>();
    if (const json& range = in.at("uncertain"); !range.is_null()) {
      r.uncertain =
          LineRange{range.at("first").get<std::int64_t>(), range.at("last").get<std::int64_t>()};
    }
    if (const json& other = in.at("recovers"); !other.is_null()) {
      r.recovers = other.get<std::int64_t>();
    }
    for (const json& item : in.at("checklist")) {
      const json& by = item.at("by");
      r.checklist.push_back({item.at("item").get<std::string>(),
                             item.at("question").get<std::string>(),
                             by.is_null() ? "" : by.get<std::string>()});
    }
    return r;
  } catch (const json::exception& e) {
    return Error{Code::kMalformed, std::string("The daemon's report of a job: ") + e.what()};
  }
}

Result<Progress> progress(const json& in) {
  try {
    Progress p;
    p.job = in.at("job").get<std::int64_t>();
    const auto state = job_state_named(in.at("state").get<std::string>());
    if (!state) return Error{Code::kMalformed, "The daemon names a job state we do not know."};
    p.state = *state;
    p.acknowledged = in.at("acknowledged").get<std::int64_t>();
    p.lines = in.at("lines").get<std::int64_t>();
    p.toggles = in.at("toggles").get<std::int64_t>();
    p.machine_s = in.at("machine_s").get<double>();
    if (const json& t = in.at("temperature_c"); !t.is_null()) p.temperature_c = t.get<double>();
    return p;
  } catch (const json::exception& e) {
    return Error{Code::kMalformed, std::string("The daemon's report of progress: ") + e.what()};
  }
}

}  // namespace reforge::api
