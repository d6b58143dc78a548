// Configuration in JSON, read strictly: a missing key, a key nobody asks for, a key given twice, a
// wrong type or a number out of range is an error that names the file and the dotted key
// (FORMATS.md). For files a person writes; hence sentences, not positions.
//
// Reading goes on after the first error with harmless values, so that readers need no branches:
//     StrictJson document = parse(...);  StrictObject root = document.root();
//     rig.name = root.text("name"); ...; root.close();  if (document.error()) return
//     *document.error();
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/result.h"

namespace reforge {

class StrictObject;

class StrictJson {
 public:
  // Text that is no JSON object yields error() at once.
  StrictJson(std::string_view text, std::string file_name);

  StrictObject root();
  // The first thing that was wrong.
  const std::optional<Error>& error() const { return error_; }
  // For checks that span several keys.
  void fail(Code code, const std::string& dotted_key, const std::string& what);
  // Whether a dotted key ("axes.x") stands in the document.
  bool has(std::string_view dotted_key) const;

 private:
  std::string file_name_;
  nlohmann::json value_;
  std::optional<Error> error_;
};

// One object of the document. close() reports keys that were not asked for.
class StrictObject {
 public:
  StrictObject(StrictJson& document, const nlohmann::json& value, std::string path);

  double number(const char* key, double min, double max);
  int integer(const char* key, int min, int max);
  bool boolean(const char* key);
  std::string text(const char* key);
  std::string one_of(const char* key, const std::vector<std::string>& choices);
  std::vector<double> numbers(const char* key, size_t count, double min, double max);
  std::vector<std::string> texts(const char* key);
  StrictObject object(const char* key);
  // Null is absence, stated on purpose.
  std::optional<StrictObject> object_or_null(const char* key);
  std::vector<StrictObject> objects(const char* key);
  bool contains(const char* key) const;
  void close();

  std::string dotted(const std::string& key) const;

 private:
  const nlohmann::json* find(const char* key);
  double checked(const nlohmann::json& value, const std::string& key, double min, double max);

  StrictJson* document_;
  const nlohmann::json* value_;
  std::string path_;
  std::set<std::string> asked_;
};

}  // namespace reforge
