// What operators and the daemon say to each other: JSON-RPC 2.0, one message a line.
//
// Bytes, methods and examples: FORMATS.md, "Operator socket". Both ends use this header, so neither
// spells a key on its own. Lines of a program are counted from 1 as an editor counts them, comments
// included. Times of day are ISO 8601 in UTC; durations are seconds of the machine's clock.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "protocols/result.h"

namespace reforge::api {

constexpr int kVersion = 1;
constexpr std::size_t kLineMax = 64 * 1024;  // bytes of one message, newline included
constexpr const char* kDefaultSocket = "/run/reforge/reforged.sock";
constexpr const char* kSocketVariable = "REFORGE_SOCKET";

// Each role may do what the ones before it may.
enum class Role { kObserve, kOperate, kAdminister };

enum class Method {
  kHello,
  kSubmit,
  kConfirm,
  kAdmit,
  kRecover,
  kReheat,
  kStart,
  kHold,
  kResume,
  kAbort,
  kEmergency,
  kClear,
  kStatus,
  kJobs,
  kSubscribe,
  kShutdown,
};
constexpr int kMethodCount = 16;

// queued -> verifying -> ready -> running <-> held -> done | failed | aborted; a daemon that finds
// a running or held job in its journal at start makes it interrupted.
enum class JobState {
  kQueued,
  kVerifying,
  kReady,
  kRunning,
  kHeld,
  kDone,
  kFailed,
  kAborted,
  kInterrupted,
};
constexpr int kJobStateCount = 9;
constexpr bool is_over(JobState state) {
  return state >= JobState::kDone;
}
constexpr bool has_the_rig(JobState state) {
  return state == JobState::kRunning || state == JobState::kHeld;
}

const char* name_of(Role role);
const char* name_of(Method method);
const char* name_of(JobState state);
std::optional<Method> method_named(std::string_view name);
std::optional<JobState> job_state_named(std::string_view name);
Role role_needed(Method method);

// Numbers of JSON-RPC; every other error carries its reforge::Code as number.
constexpr int kParseError = -32700;
constexpr int kInvalidRequest = -32600;
constexpr int kMethodNotFound = -32601;
constexpr int kInvalidParams = -32602;

struct Request {
  nlohmann::json id;  // null in a notification, which is not answered
  bool answered = false;
  Method method = Method::kHello;
  nlohmann::json params;  // always an object
};

// The error object of an answer.
struct Failure {
  int code;
  std::string sentence;
};

// What is wrong with a line that is no request.
struct Refusal {
  nlohmann::json id;
  Failure failure;
};

// One line without its newline. Never throws, whatever the bytes.
std::variant<Request, Refusal> parse_request(std::string_view line);

// Reads parameters and remembers the first fault; unknown keys are faults too.
class Params {
 public:
  explicit Params(const nlohmann::json& object) : object_(object) {}
  std::string text(const char* key, std::size_t bytes_max = 4096);
  std::int64_t number(const char* key, std::int64_t min, std::int64_t max);
  std::optional<std::int64_t> optional_number(const char* key, std::int64_t min, std::int64_t max);
  std::optional<double> optional_real(const char* key, double min, double max);
  std::optional<std::string> optional_text(const char* key, std::size_t bytes_max = 4096);
  // Absent: none.
  std::vector<std::string> texts(const char* key, std::size_t count_max);
  bool flag(const char* key);  // absent: false
  // After all keys were asked for: empty, or the sentence of the first fault.
  const std::string& fault();

 private:
  const nlohmann::json* find(const char* key, bool needed);
  void complain(std::string sentence);

  const nlohmann::json& object_;
  std::vector<std::string> asked_;
  std::string fault_;
};

// Messages to clients, without the newline.
std::string response(const nlohmann::json& id, const nlohmann::json& result);
std::string error_response(const nlohmann::json& id, const Failure& failure);
std::string notification(std::string_view method, const nlohmann::json& params);

struct LineRange {
  std::int64_t first;
  std::int64_t last;
};

// One thing a person looks at before a job starts.
struct ChecklistItem {
  std::string item;      // "stock"
  std::string question;  // what is confirmed by it
  std::string by;        // who has; empty: nobody yet
};

struct JobReport {
  std::int64_t job = 0;
  std::string name;
  JobState state = JobState::kQueued;
  std::string reason;  // why it is in that state, when that needs a word
  std::string mode;    // paper or strict
  std::string submitted_by;
  std::string submitted_at;
  std::string changed_at;
  std::string program_sha256;
  std::int64_t lines = 0;         // of the program
  std::int64_t executed = 0;      // certainly executed: motion was drained behind it
  std::int64_t acknowledged = 0;  // every line up to here is journalled as acknowledged
  std::int64_t horizon = 0;       // no line beyond this one was ever allowed onto the wire
  std::int64_t toggles = 0;       // M70-M75 relayed to the extruder and acknowledged
  double machine_s = 0;           // running time on the machine's clock, holds included
  double estimated_s = 0;         // by the verifier's motion model
  // Lines that may or may not have been sent, once the job has ended before its last line.
  std::optional<LineRange> uncertain;
  std::optional<std::int64_t> recovers;  // the job this one finishes
  std::vector<ChecklistItem> checklist;  // of a job that waits; empty otherwise
};

struct LinkReport {
  bool up = false;
  std::string path;
  std::string state;   // as the device calls it; empty while down
  std::string detail;  // alarm, fault or why the link is down
};

struct RigReport {
  std::string name;
  std::string state;  // of the rig's state machine
  std::string reason;
  LinkReport cnc;
  LinkReport extruder;
  std::optional<double> temperature_c;  // absent: unknown, never "fine"
  std::optional<double> target_c;
  double clock_s = 0;  // the machine's clock since the daemon started
};

// Sent often and droppable: the next one says it all again.
struct Progress {
  std::int64_t job = 0;
  JobState state = JobState::kRunning;
  std::int64_t acknowledged = 0;
  std::int64_t lines = 0;
  std::int64_t toggles = 0;
  double machine_s = 0;
  std::optional<double> temperature_c;
};

nlohmann::json to_json(const JobReport& report);
nlohmann::json to_json(const RigReport& report);
nlohmann::json to_json(const Progress& progress);
Result<JobReport> job_report(const nlohmann::json& json);
Result<Progress> progress(const nlohmann::json& json);

}  // namespace reforge::api
