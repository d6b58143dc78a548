#include "controller/io/journal_store.h"

#include <sqlite3.h>

#include <array>
#include <cassert>
#include <chrono>
#include <cstdio>
#include <ctime>

namespace reforge::journal {
namespace {

constexpr int kApplicationId = 0x52464A31;  // "RFJ1"
constexpr int kVersion = 3;
// For another reader of the file; a checkpoint of ours is never that long.
constexpr int kBusyTimeoutMs = 2000;

constexpr const char* kSchema = R"sql(
CREATE TABLE jobs (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  name TEXT NOT NULL, folder TEXT NOT NULL UNIQUE,
  program_sha256 TEXT NOT NULL, rig_sha256 TEXT NOT NULL, mode TEXT NOT NULL,
  lines INTEGER NOT NULL, prints INTEGER NOT NULL, estimated_s REAL NOT NULL,
  recovers INTEGER REFERENCES jobs(id), first_line INTEGER NOT NULL,
  submitted_by TEXT NOT NULL, submitted_at TEXT NOT NULL,
  state TEXT NOT NULL, reason TEXT NOT NULL, changed_at TEXT NOT NULL,
  executed INTEGER NOT NULL DEFAULT 0, acknowledged INTEGER NOT NULL DEFAULT 0,
  sent INTEGER, horizon INTEGER NOT NULL DEFAULT 0,
  toggles INTEGER NOT NULL DEFAULT 0, machine_s REAL NOT NULL DEFAULT 0
) STRICT;
CREATE TABLE job_changes (
  job INTEGER NOT NULL REFERENCES jobs(id), state TEXT NOT NULL, reason TEXT NOT NULL,
  at TEXT NOT NULL
) STRICT;
CREATE TABLE acknowledgements (
  job INTEGER NOT NULL REFERENCES jobs(id), first_line INTEGER NOT NULL,
  last_line INTEGER NOT NULL, at TEXT NOT NULL
) STRICT;
CREATE TABLE horizons (
  job INTEGER NOT NULL REFERENCES jobs(id), line INTEGER NOT NULL, at TEXT NOT NULL
) STRICT;
CREATE TABLE rig_changes (
  from_state TEXT NOT NULL, to_state TEXT NOT NULL, reason TEXT NOT NULL, at TEXT NOT NULL
) STRICT;
CREATE TABLE confirmations (
  job INTEGER NOT NULL REFERENCES jobs(id), item TEXT NOT NULL, who TEXT NOT NULL, at TEXT NOT NULL
) STRICT;
CREATE TABLE acts (
  who TEXT NOT NULL, method TEXT NOT NULL, params TEXT NOT NULL, outcome TEXT NOT NULL,
  at TEXT NOT NULL
) STRICT;
)sql";

using Database = std::unique_ptr<sqlite3, decltype(&sqlite3_close)>;

// A prepared statement; the first failure is kept by the database's own error message.
class Statement {
 public:
  Statement(sqlite3* database, const char* sql) : statement_(nullptr, &sqlite3_finalize) {
    sqlite3_stmt* raw = nullptr;
    ok_ = sqlite3_prepare_v2(database, sql, -1, &raw, nullptr) == SQLITE_OK;
    statement_.reset(raw);
  }

  Statement& bind(std::int64_t value) {
    ok_ = ok_ && sqlite3_bind_int64(statement_.get(), ++bound_, value) == SQLITE_OK;
    return *this;
  }
  Statement& bind(double value) {
    ok_ = ok_ && sqlite3_bind_double(statement_.get(), ++bound_, value) == SQLITE_OK;
    return *this;
  }
  Statement& bind(const std::string& value) {
    ok_ = ok_ && sqlite3_bind_text(statement_.get(), ++bound_, value.data(),
                                   static_cast<int>(value.size()), SQLITE_TRANSIENT) == SQLITE_OK;
    return *this;
  }
  Statement& bind(const std::optional<JobId>& value) {
    if (value) return bind(*value);
    ok_ = ok_ && sqlite3_bind_null(statement_.get(), ++bound_) == SQLITE_OK;
    return *this;
  }
  Statement& bind(const char* value) { return bind(std::string(value)); }
  Statement& bind(JobId value) { return bind(static_cast<std::int64_t>(value)); }

  bool row() { return ok_ && sqlite3_step(statement_.get()) == SQLITE_ROW; }
  bool done() { return ok_ && sqlite3_step(statement_.get()) == SQLITE_DONE; }

  std::int64_t number(int column) { return sqlite3_column_int64(statement_.get(), column); }
  double real(int column) { return sqlite3_column_double(statement_.get(), column); }
  bool null(int column) { return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL; }
  std::string text(int column) {
    const unsigned char* bytes = sqlite3_column_text(statement_.get(), column);
    return bytes == nullptr ? "" : reinterpret_cast<const char*>(bytes);
  }

 private:
  std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)> statement_;
  bool ok_ = false;
  int bound_ = 0;
};

}  // namespace

struct Store::Impl {
  explicit Impl(std::filesystem::path path) : file(std::move(path)), database(nullptr, nullptr) {}

  std::filesystem::path file;
  Database database;

  sqlite3* db() const { return database.get(); }

  Error error(const std::string& what) const {
    return {Code::kJournal, "The journal " + file.string() + " " + what + ": " +
                                (db() == nullptr ? "out of memory" : sqlite3_errmsg(db())) + "."};
  }

  bool run(const char* sql) {
    return sqlite3_exec(db(), sql, nullptr, nullptr, nullptr) == SQLITE_OK;
  }

  std::int64_t pragma(const char* sql) {
    Statement statement(db(), sql);
    return statement.row() ? statement.number(0) : -1;
  }

  bool write(const Record& record, JobId& added) {
    const std::string at = now_utc();
    return std::visit([&](const auto& fact) { return write(fact, at, added); }, record);
  }

  bool write(const AddJob& fact, const std::string& at, JobId& added) {
    const NewJob& job = fact.job;
    const char* state = api::name_of(api::JobState::kQueued);
    const bool ok =
        Statement(db(),
                  "INSERT INTO jobs (name, folder, program_sha256, rig_sha256, mode, lines, "
                  "prints, estimated_s, submitted_by, submitted_at, state, reason, changed_at, "
                  "recovers, first_line, executed, acknowledged, horizon) "
                  "VALUES (?1,?2,?3,?4,?5,?6,?7,?8,?9,?10,?11,?12,?13,?14,?15,?15-1,?15-1,?15-1)")
            .bind(job.name)
            .bind(job.folder)
            .bind(job.program_sha256)
            .bind(job.rig_sha256)
            .bind(job.mode)
            .bind(job.lines)
            .bind(std::int64_t{job.prints})
            .bind(job.estimated_s)
            .bind(job.submitted_by)
            .bind(at)
            .bind(state)
            .bind("")
            .bind(at)
            .bind(job.recovers)
            .bind(job.first_line)
            .done();
    added = JobId{sqlite3_last_insert_rowid(db())};
    return ok && log_state(added, state, "", at);
  }

  bool log_state(JobId job, const char* state, const std::string& reason, const std::string& at) {
    return Statement(db(), "INSERT INTO job_changes VALUES (?,?,?,?)")
        .bind(job)
        .bind(state)
        .bind(reason)
        .bind(at)
        .done();
  }

  bool write(const ChangeJob& fact, const std::string& at, JobId&) {
    const char* state = api::name_of(fact.state);
    bool ok = Statement(db(), "UPDATE jobs SET state=?, reason=?, changed_at=? WHERE id=?")
                  .bind(state)
                  .bind(fact.reason)
                  .bind(at)
                  .bind(fact.job)
                  .done() &&
              log_state(fact.job, state, fact.reason, at);
    if (ok && fact.certainty) {
      ok = acknowledge({fact.job, *fact.certainty, fact.toggles, fact.machine_s}, at);
      // Only what the daemon saw to its end says how far it really sent.
      if (ok && is_over(fact.state)) {
        ok = Statement(db(), "UPDATE jobs SET sent=? WHERE id=?")
                 .bind(fact.certainty->sent)
                 .bind(fact.job)
                 .done();
      }
    }
    return ok;
  }

  bool write(const Acknowledge& fact, const std::string& at, JobId&) {
    return acknowledge(fact, at);
  }

  bool acknowledge(const Acknowledge& fact, const std::string& at) {
    // First the lines that are new, then the mark they move.
    return Statement(db(),
                     "INSERT INTO acknowledgements SELECT id, acknowledged + 1, ?1, ?2 FROM jobs "
                     "WHERE id = ?3 AND acknowledged < ?1")
               .bind(fact.certainty.acknowledged)
               .bind(at)
               .bind(fact.job)
               .done() &&
           Statement(db(),
                     "UPDATE jobs SET executed = max(executed, ?), acknowledged = "
                     "max(acknowledged, ?), toggles = ?, machine_s = ? WHERE id = ?")
               .bind(fact.certainty.executed)
               .bind(fact.certainty.acknowledged)
               .bind(fact.toggles)
               .bind(fact.machine_s)
               .bind(fact.job)
               .done();
  }

  bool write(const RaiseHorizon& fact, const std::string& at, JobId&) {
    return Statement(db(), "UPDATE jobs SET horizon = max(horizon, ?) WHERE id = ?")
               .bind(fact.line)
               .bind(fact.job)
               .done() &&
           Statement(db(), "INSERT INTO horizons VALUES (?,?,?)")
               .bind(fact.job)
               .bind(fact.line)
               .bind(at)
               .done();
  }

  bool write(const ChangeRig& fact, const std::string& at, JobId&) {
    return Statement(db(), "INSERT INTO rig_changes VALUES (?,?,?,?)")
        .bind(fact.from)
        .bind(fact.to)
        .bind(fact.reason)
        .bind(at)
        .done();
  }

  bool write(const Confirm& fact, const std::string& at, JobId&) {
    return Statement(db(), "INSERT INTO confirmations VALUES (?,?,?,?)")
        .bind(fact.job)
        .bind(fact.item)
        .bind(fact.who)
        .bind(at)
        .done();
  }

  bool write(const Act& fact, const std::string& at, JobId&) {
    return Statement(db(), "INSERT INTO acts VALUES (?,?,?,?,?)")
        .bind(fact.who)
        .bind(fact.method)
        .bind(fact.params)
        .bind(fact.outcome)
        .bind(at)
        .done();
  }
};

Store::Store(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;
Store::~Store() = default;

Result<Store> Store::open(const std::filesystem::path& file) {
  auto impl = std::make_unique<Impl>(file);
  sqlite3* raw = nullptr;
  const int opened =
      sqlite3_open_v2(file.c_str(), &raw,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
  impl->database = Database(raw, &sqlite3_close);
  if (opened != SQLITE_OK) return impl->error("cannot be opened");
  sqlite3_busy_timeout(raw, kBusyTimeoutMs);
  if (!impl->run("PRAGMA journal_mode=WAL") || !impl->run("PRAGMA synchronous=FULL") ||
      !impl->run("PRAGMA foreign_keys=ON")) {
    return impl->error("cannot be used");
  }
  const std::int64_t application = impl->pragma("PRAGMA application_id");
  const std::int64_t tables = impl->pragma("SELECT count(*) FROM sqlite_schema");
  if (application < 0 || tables < 0) return impl->error("cannot be read");
  if (application == 0 && tables == 0) {
    const std::string marks = "PRAGMA application_id=" + std::to_string(kApplicationId) +
                              "; PRAGMA user_version=" + std::to_string(kVersion) + ";";
    const std::string all = std::string("BEGIN;") + kSchema + marks + "COMMIT;";
    if (!impl->run(all.c_str())) return impl->error("cannot be begun");
  } else if (application != kApplicationId || impl->pragma("PRAGMA user_version") != kVersion) {
    return Error{Code::kWrongVersion,
                 "The journal " + file.string() + " is not one of this version of reforged."};
  }
  Statement check(raw, "PRAGMA quick_check(1)");
  if (!check.row() || check.text(0) != "ok") {
    return Error{Code::kJournal, "The journal " + file.string() +
                                     " is damaged; move it aside to start with an empty queue."};
  }
  return Store(std::move(impl));
}

Result<std::vector<StoredJob>> Store::jobs() {
  std::vector<StoredJob> out;
  Statement statement(
      impl_->db(),
      "SELECT id, name, folder, program_sha256, rig_sha256, mode, lines, "
      "estimated_s, submitted_by, submitted_at, state, reason, changed_at, "
      "executed, acknowledged, sent, horizon, toggles, machine_s, prints, recovers, "
      "first_line "
      "FROM jobs ORDER BY id");
  while (statement.row()) {
    StoredJob job;
    job.id = JobId{statement.number(0)};
    job.submitted = {statement.text(1),
                     statement.text(2),
                     statement.text(3),
                     statement.text(4),
                     statement.text(5),
                     statement.number(6),
                     statement.real(7),
                     statement.text(8),
                     false,
                     std::nullopt,
                     1};
    job.submitted_at = statement.text(9);
    const auto state = api::job_state_named(statement.text(10));
    if (!state) return Error{Code::kJournal, "The journal names a job state that does not exist."};
    job.state = *state;
    job.reason = statement.text(11);
    job.changed_at = statement.text(12);
    job.certainty.executed = statement.number(13);
    job.certainty.acknowledged = statement.number(14);
    job.sent_known = !statement.null(15);
    job.certainty.horizon = statement.number(16);
    job.certainty.sent = job.sent_known ? statement.number(15) : job.certainty.horizon;
    job.toggles = statement.number(17);
    job.machine_s = statement.real(18);
    job.submitted.prints = statement.number(19) != 0;
    if (!statement.null(20)) job.submitted.recovers = JobId{statement.number(20)};
    job.submitted.first_line = statement.number(21);
    out.push_back(std::move(job));
  }
  if (sqlite3_errcode(impl_->db()) != SQLITE_DONE && sqlite3_errcode(impl_->db()) != SQLITE_OK) {
    return impl_->error("cannot be read");
  }
  return out;
}

Result<bool> Store::rig_was_left_suspended() {
  // Only `idle` says that the CNC had nothing left to do.
  Statement statement(impl_->db(),
                      "SELECT count(*) FROM rig_changes WHERE rowid > "
                      "(SELECT coalesce(max(rowid), 0) FROM rig_changes WHERE to_state = 'idle') "
                      "AND to_state NOT IN ('disconnected', 'identifying', 'fault')");
  if (!statement.row()) return impl_->error("cannot be read");
  return statement.number(0) > 0;
}

Result<std::vector<JobId>> Store::write(const std::vector<Record>& records) {
  if (!impl_->run("BEGIN IMMEDIATE")) return impl_->error("cannot be written");
  std::vector<JobId> added(records.size(), JobId{0});
  bool ok = true;
  for (std::size_t i = 0; ok && i < records.size(); ++i) ok = impl_->write(records[i], added[i]);
  ok = ok && impl_->run("COMMIT");
  if (ok) return added;
  const Error error = impl_->error("cannot be written");
  // A full disk or an I/O error may have rolled back by itself already.
  if (sqlite3_get_autocommit(impl_->db()) == 0) impl_->run("ROLLBACK");
  return error;
}

std::string now_utc() {
  const auto now = std::chrono::system_clock::now();
  const std::time_t seconds = std::chrono::system_clock::to_time_t(now);
  const auto ms =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count() % 1000;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  std::array<char, 32> text{};
  const std::size_t length = std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &parts);
  std::snprintf(text.data() + length, text.size() - length, ".%03dZ", static_cast<int>(ms));
  return text.data();
}

}  // namespace reforge::journal
