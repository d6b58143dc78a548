#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>

#include <boost/asio/io_context.hpp>

#include "controller/io/journal.h"
#include "tests/rig/scratch_folder.h"
#include "tests/support/job_folder.h"

namespace reforge {
namespace {

using journal::Acknowledge;
using journal::Act;
using journal::AddJob;
using journal::ChangeJob;
using journal::ChangeRig;
using journal::RaiseHorizon;
using journal::Store;
using reforge::testing::read_file;
using reforge::testing::write_file;

journal::NewJob bracket(const std::string& folder = "a1") {
  journal::NewJob job;
  job.name = "bracket";
  job.folder = folder;
  job.program_sha256 = "12ab";
  job.rig_sha256 = "34cd";
  job.mode = "strict";
  job.lines = 500;
  job.estimated_s = 60.5;
  job.submitted_by = "anna (uid 1000, pid 7)";
  return job;
}

class JournalFile : public ::testing::Test {
 protected:
  Store open(const std::filesystem::path& path) {
    auto store = Store::open(path);
    EXPECT_TRUE(store.ok()) << store.error().sentence;
    return std::move(*store);
  }
  Store open() { return open(file_); }

  static void write(Store& store, const std::vector<journal::Record>& records) {
    const auto written = store.write(records);
    ASSERT_TRUE(written.ok()) << written.error().sentence;
  }

  ScratchFolder scratch_;
  std::filesystem::path file_ = scratch_.path / "journal.sqlite";
};

TEST_F(JournalFile, WhatWasWrittenIsReadByTheNextDaemon) {
  {
    Store store = open();
    const auto added = store.write({AddJob{bracket()}, AddJob{bracket("b2")}});
    ASSERT_TRUE(added.ok());
    EXPECT_EQ((*added)[0], JobId{1});
    EXPECT_EQ((*added)[1], JobId{2});
    write(store, {RaiseHorizon{JobId{1}, 200},
                  ChangeJob{JobId{1}, api::JobState::kRunning, "", LineCertainty{}, 0, 0},
                  Acknowledge{JobId{1}, {10, 42, 60, 200}, 3, 12.5}});
  }
  Store store = open();
  const auto jobs = store.jobs();
  ASSERT_TRUE(jobs.ok());
  ASSERT_EQ(jobs->size(), 2u);
  const journal::StoredJob& job = jobs->front();
  EXPECT_EQ(job.submitted.name, "bracket");
  EXPECT_EQ(job.submitted.submitted_by, "anna (uid 1000, pid 7)");
  EXPECT_EQ(job.state, api::JobState::kRunning);
  EXPECT_EQ(job.certainty.executed, 10);
  EXPECT_EQ(job.certainty.acknowledged, 42);
  EXPECT_EQ(job.certainty.horizon, 200);
  EXPECT_EQ(job.toggles, 3);
  EXPECT_EQ(job.machine_s, 12.5);
  EXPECT_EQ(jobs->back().state, api::JobState::kQueued);
}

TEST_F(JournalFile, SentIsKnownOnlyWhenTheEndWasSeen) {
  Store store = open();
  write(store, {AddJob{bracket()}, RaiseHorizon{JobId{1}, 200},
                Acknowledge{JobId{1}, {0, 42, 60, 200}, 0, 0}});
  EXPECT_FALSE(store.jobs()->front().sent_known);
  write(store,
        {ChangeJob{JobId{1}, api::JobState::kAborted, "", LineCertainty{0, 42, 60, 200}, 0, 0}});
  EXPECT_TRUE(store.jobs()->front().sent_known);
  EXPECT_EQ(store.jobs()->front().certainty.sent, 60);
}

TEST_F(JournalFile, LateAcknowledgementDoesNotGoBack) {
  Store store = open();
  write(store, {AddJob{bracket()}, Acknowledge{JobId{1}, {10, 42, 60, 200}, 0, 0},
                Acknowledge{JobId{1}, {5, 20, 60, 200}, 0, 0}});
  EXPECT_EQ(store.jobs()->front().certainty.acknowledged, 42);
  EXPECT_EQ(store.jobs()->front().certainty.executed, 10);
}

TEST_F(JournalFile, BatchThatFailsLeavesNothingBehind) {
  Store store = open();
  // The second job claims the folder of the first.
  EXPECT_FALSE(store.write({AddJob{bracket()}, AddJob{bracket()}}).ok());
  EXPECT_TRUE(store.jobs()->empty());
}

// As after a power cut in the middle of a write: what was committed before stands.
TEST_F(JournalFile, TornLastRecordIsIgnored) {
  Store store = open();
  write(store, {AddJob{bracket()}});
  const std::string wal_before = read_file(file_.string() + "-wal");
  write(store, {RaiseHorizon{JobId{1}, 200}});
  const std::string wal_after = read_file(file_.string() + "-wal");
  ASSERT_GT(wal_after.size(), wal_before.size());

  for (const std::size_t cut : {wal_after.size() - 1, wal_before.size() + 30}) {
    const auto copy = scratch_.path / ("torn-" + std::to_string(cut));
    write_file(copy, read_file(file_));
    write_file(copy.string() + "-wal", wal_after.substr(0, cut));
    Store torn = open(copy);
    const auto jobs = torn.jobs();
    ASSERT_EQ(jobs->size(), 1u);
    EXPECT_EQ(jobs->front().certainty.horizon, 0);
  }
}

TEST_F(JournalFile, DamagedFileIsRefused) {
  {
    Store store = open();
    write(store, {AddJob{bracket()}});
  }
  std::string bytes = read_file(file_);
  for (std::size_t i = 4096; i < bytes.size(); ++i) bytes[i] = 'x';
  write_file(file_, bytes);
  EXPECT_FALSE(Store::open(file_).ok());
}

TEST_F(JournalFile, ForeignFileIsRefusedAndKept) {
  const std::string text(5000, 'a');
  write_file(file_, text);
  EXPECT_FALSE(Store::open(file_).ok());
  EXPECT_EQ(read_file(file_), text);
}

TEST_F(JournalFile, OtherVersionIsRefused) {
  { open(); }
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
  sqlite3_exec(database, "PRAGMA user_version=99", nullptr, nullptr, nullptr);
  sqlite3_close(database);
  EXPECT_EQ(Store::open(file_).error().code, Code::kWrongVersion);
}

TEST_F(JournalFile, RigLeftWithWorkIsRememberedUntilItWasIdle) {
  Store store = open();
  EXPECT_FALSE(*store.rig_was_left_suspended());
  write(store, {ChangeRig{"idle", "starting", ""}, ChangeRig{"starting", "running", ""}});
  EXPECT_TRUE(*store.rig_was_left_suspended());
  // A daemon that came up and died again before anybody cleared the rig.
  write(store, {ChangeRig{"disconnected", "identifying", ""}});
  EXPECT_TRUE(*store.rig_was_left_suspended());
  write(store, {ChangeRig{"identifying", "idle", ""}});
  EXPECT_FALSE(*store.rig_was_left_suspended());
}

class JournalThread : public JournalFile {
 protected:
  Journal::Handlers handlers() {
    return {[this](const std::string& sentence) { troubles_.push_back(sentence); },
            [this](const Acknowledge& lines) { acknowledged_ = lines.certainty.acknowledged; }};
  }

  // Runs the loop until `done` or ten seconds have passed.
  template <typename Done>
  bool run_until(Done done) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (!done() && std::chrono::steady_clock::now() < end) {
      io_.run_for(std::chrono::milliseconds(5));
      io_.restart();
    }
    return done();
  }

  boost::asio::io_context io_;
  std::vector<std::string> troubles_;
  LineNumber acknowledged_ = 0;
};

TEST_F(JournalThread, DurableIsToldInOrder) {
  std::vector<int> told;
  Journal journal(io_, open(), handlers());
  journal.write(AddJob{bracket()}, [&](JobId job) {
    EXPECT_EQ(job, JobId{1});
    told.push_back(1);
  });
  journal.write(RaiseHorizon{JobId{1}, 10}, [&](JobId) { told.push_back(2); });
  EXPECT_TRUE(run_until([&] { return told.size() == 2; }));
  EXPECT_EQ(told, (std::vector<int>{1, 2}));
}

TEST_F(JournalThread, EndingWritesWhatIsLeft) {
  {
    Journal journal(io_, open(), handlers());
    journal.write(AddJob{bracket()});
    journal.write(Acknowledge{JobId{1}, {0, 7, 7, 7}, 0, 0});
  }
  EXPECT_EQ(open().jobs()->front().certainty.acknowledged, 7);
}

TEST_F(JournalThread, AcknowledgementsArriveThoughTheyWaitForCompany) {
  Journal journal(io_, open(), handlers());
  journal.write(AddJob{bracket()});
  for (LineNumber line = 1; line <= 100; ++line) {
    journal.write(Acknowledge{JobId{1}, {0, line, line, 200}, 0, 0});
  }
  EXPECT_TRUE(run_until([&] { return acknowledged_ == 100; }));
}

// A limit on the size of files stands for the full disk: writing fails in the middle.
TEST_F(JournalThread, FullDiskIsToldAndNothingIsLost) {
  Journal journal(io_, open(), handlers());
  bool added = false;
  journal.write(AddJob{bracket()}, [&](JobId) { added = true; });
  ASSERT_TRUE(run_until([&] { return added; }));

  const auto before = signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit tiny{1024, limit.rlim_max};
  setrlimit(RLIMIT_FSIZE, &tiny);
  bool durable = false;
  journal.write(RaiseHorizon{JobId{1}, 200}, [&](JobId) { durable = true; });
  const bool told = run_until([&] { return !troubles_.empty(); });
  setrlimit(RLIMIT_FSIZE, &limit);
  signal(SIGXFSZ, before);

  ASSERT_TRUE(told);
  EXPECT_NE(troubles_.front(), "");
  EXPECT_FALSE(durable);
  EXPECT_TRUE(run_until([&] { return durable; }));
  EXPECT_EQ(troubles_.back(), "");
  EXPECT_FALSE(journal.in_trouble());
  EXPECT_EQ(open().jobs()->front().certainty.horizon, 200);
}

TEST_F(JournalThread, LockedFileIsToldAndNothingIsLost) {
  Journal journal(io_, open(), handlers());
  bool added = false;
  journal.write(AddJob{bracket()}, [&](JobId) { added = true; });
  ASSERT_TRUE(run_until([&] { return added; }));
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  bool durable = false;
  journal.write(RaiseHorizon{JobId{1}, 200}, [&](JobId) { durable = true; });
  EXPECT_TRUE(run_until([&] { return !troubles_.empty(); }));
  EXPECT_FALSE(durable);
  sqlite3_exec(other, "ROLLBACK", nullptr, nullptr, nullptr);
  sqlite3_close(other);
  EXPECT_TRUE(run_until([&] { return durable; }));
}

}  // namespace
}  // namespace reforge
