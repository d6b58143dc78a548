// Result<T>: a value, or an error that a person can act on.
//
// Whatever the world can do wrong (a bad file, a lost link, an impossible request) is returned as an
// Error: a code for programs and one sentence for people that says what was found, where, and what
// was expected. What only we can do wrong is an assert, never an Error. Exceptions thrown by
// libraries stop in the file that called the library.
//
// Each folder owns a range of codes. A code is never renumbered and never reused.
#pragma once

#include <cassert>
#include <string>
#include <utility>
#include <variant>

namespace reforge {

enum class Code {
  // 1xx: protocols — files and messages that cannot be understood.
  kUnreadable = 100,     // a file cannot be opened, read or written
  kMalformed = 101,      // text or bytes that do not parse
  kUnknownKey = 102,     // a configuration key nobody reads
  kOutOfRange = 103,     // a number outside its stated bounds
  kWrongVersion = 104,   // a format or protocol version we do not speak
  kHashMismatch = 105,   // bytes are not those a certificate or header was made for

  // 2xx: planner — inputs that are no part, and jobs that cannot be planned.
  kBadMesh = 200,        // not a closed, oriented, finite solid without self-intersection
  kDoesNotFit = 201,     // outside the machine's working space, or implausible as millimetres
  kBooleanFailed = 202,  // the exact volumes could not be computed
  kNoFeasiblePlan = 203, // a plan does not exist under the constraints (the reasons are data)
  kUnreachable = 204,    // no rotary solution within the machine's limits
  kInterrupted = 205,    // stopped by deadline or by the operator; nothing was written
  kNotCertified = 206,   // the verifier found faults in a program

  // 3xx: controller — the daemon, its devices and its journal.
  kRefused = 300,        // the state of the rig does not allow this now
  kNotAllowed = 301,     // the peer lacks the role
  kNoSuchJob = 302,
  kDevice = 303,         // a device answered with an error, or not at all
  kJournal = 304,        // the journal cannot be written or is damaged
  kBusy = 305,           // a bound was reached (queue, rate, clients)

  // 4xx: tools.
  kUsage = 400,
};

struct Error {
  Code code;
  std::string sentence;
};

template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}                     // NOLINT(google-explicit-constructor)
  Result(Error error) : state_(std::move(error)) {}                 // NOLINT(google-explicit-constructor)
  static Result fail(Code code, std::string sentence) {
    return Result(Error{code, std::move(sentence)});
  }

  bool ok() const { return std::holds_alternative<T>(state_); }
  explicit operator bool() const { return ok(); }

  T& value() & { return assert(ok()), *std::get_if<T>(&state_); }
  const T& value() const& { return assert(ok()), *std::get_if<T>(&state_); }
  T&& value() && { return assert(ok()), std::move(*std::get_if<T>(&state_)); }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const { return assert(!ok()), *std::get_if<Error>(&state_); }

 private:
  std::variant<T, Error> state_;
};

// A Result without a value: `Status done = write(...); if (!done) ...`.
struct Unit {};
using Status = Result<Unit>;

}  // namespace reforge
