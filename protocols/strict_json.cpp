#include "protocols/strict_json.h"

#include <charconv>
#include <cmath>

namespace reforge {
namespace {

const nlohmann::json kEmptyObject = nlohmann::json::object();

std::string shortest(double value) {
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value);
  return std::string(text, end.ptr);
}

std::string shown(const nlohmann::json& value) {
  std::string text = value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return text.size() > 40 ? text.substr(0, 37) + "..." : text;
}

}  // namespace

StrictJson::StrictJson(std::string_view text, std::string file_name)
    : file_name_(std::move(file_name)), value_(nlohmann::json::object()) {
  // The library keeps the last of two equal keys silently; a person meant one of them.
  std::vector<std::set<std::string>> open;
  std::string twice;
  const auto watch = [&](int, nlohmann::json::parse_event_t event, nlohmann::json& parsed) {
    if (event == nlohmann::json::parse_event_t::object_start) open.emplace_back();
    if (event == nlohmann::json::parse_event_t::object_end) open.pop_back();
    if (event == nlohmann::json::parse_event_t::key) {
      const auto& key = parsed.get_ref<const std::string&>();
      if (!open.back().insert(key).second && twice.empty()) twice = key;
    }
    return true;
  };
  try {
    nlohmann::json parsed = nlohmann::json::parse(text, watch);
    if (!parsed.is_object()) {
      error_ = Error{Code::kMalformed, file_name_ + " must hold one JSON object"};
    } else if (!twice.empty()) {
      error_ = Error{Code::kMalformed, file_name_ + ": the key \"" + twice + "\" stands twice"};
    } else {
      value_ = std::move(parsed);
    }
  } catch (const nlohmann::json::exception& e) {
    error_ = Error{Code::kMalformed, file_name_ + " is not valid JSON: " + e.what()};
  }
}

StrictObject StrictJson::root() {
  return StrictObject(*this, value_, "");
}

void StrictJson::fail(Code code, const std::string& dotted_key, const std::string& what) {
  if (!error_) error_ = Error{code, file_name_ + ": " + dotted_key + " " + what};
}

bool StrictJson::has(std::string_view dotted_key) const {
  const nlohmann::json* at = &value_;
  while (true) {
    const size_t dot = dotted_key.find('.');
    const std::string key(dotted_key.substr(0, dot));
    if (!at->is_object() || !at->contains(key)) return false;
    at = &(*at)[key];
    if (dot == std::string_view::npos) return true;
    dotted_key.remove_prefix(dot + 1);
  }
}

StrictObject::StrictObject(StrictJson& document, const nlohmann::json& value, std::string path)
    : document_(&document), value_(&value), path_(std::move(path)) {}

std::string StrictObject::dotted(const std::string& key) const {
  return path_.empty() ? key : path_ + "." + key;
}

const nlohmann::json* StrictObject::find(const char* key) {
  asked_.insert(key);
  const auto at = value_->find(key);
  if (at == value_->end()) {
    document_->fail(Code::kMalformed, dotted(key), "is missing");
    return nullptr;
  }
  return &*at;
}

bool StrictObject::contains(const char* key) const {
  return value_->contains(key);
}

double StrictObject::checked(const nlohmann::json& value, const std::string& key, double min,
                             double max) {
  if (!value.is_number()) {
    document_->fail(Code::kMalformed, key, "must be a number, not " + shown(value));
    return min;
  }
  const double number = value.get<double>();
  if (!(number >= min && number <= max)) {
    document_->fail(
        Code::kOutOfRange, key,
        "is " + shown(value) + " but must lie between " + shortest(min) + " and " + shortest(max));
    return min;
  }
  return number;
}

double StrictObject::number(const char* key, double min, double max) {
  const nlohmann::json* value = find(key);
  return value ? checked(*value, dotted(key), min, max) : min;
}

int StrictObject::integer(const char* key, int min, int max) {
  const double value = number(key, min, max);
  if (value != std::floor(value)) {
    document_->fail(Code::kOutOfRange, dotted(key), "must be a whole number");
    return min;
  }
  return static_cast<int>(value);
}

bool StrictObject::boolean(const char* key) {
  const nlohmann::json* value = find(key);
  if (value && !value->is_boolean()) {
    document_->fail(Code::kMalformed, dotted(key), "must be true or false, not " + shown(*value));
  }
  return value && value->is_boolean() && value->get<bool>();
}

std::string StrictObject::text(const char* key) {
  const nlohmann::json* value = find(key);
  if (!value) return {};
  if (!value->is_string() || value->get_ref<const std::string&>().empty()) {
    document_->fail(Code::kMalformed, dotted(key), "must be a text, not " + shown(*value));
    return {};
  }
  return value->get<std::string>();
}

std::string StrictObject::one_of(const char* key, const std::vector<std::string>& choices) {
  const std::string given = text(key);
  std::string listed;
  for (const std::string& choice : choices) {
    if (given == choice) return given;
    listed += (listed.empty() ? "\"" : ", \"") + choice + "\"";
  }
  document_->fail(Code::kOutOfRange, dotted(key),
                  "is \"" + given + "\" but must be one of " + listed);
  return choices.front();
}

std::vector<double> StrictObject::numbers(const char* key, size_t count, double min, double max) {
  const nlohmann::json* value = find(key);
  std::vector<double> result(count, min);
  if (!value) return result;
  if (!value->is_array() || value->size() != count) {
    document_->fail(Code::kMalformed, dotted(key),
                    "must be a list of " + std::to_string(count) + " numbers");
    return result;
  }
  for (size_t i = 0; i < count; ++i) {
    result[i] = checked((*value)[i], dotted(key) + "[" + std::to_string(i) + "]", min, max);
  }
  return result;
}

std::vector<std::string> StrictObject::texts(const char* key) {
  const nlohmann::json* value = find(key);
  std::vector<std::string> result;
  if (!value) return result;
  bool all_text = value->is_array();
  for (size_t i = 0; all_text && i < value->size(); ++i) {
    all_text = (*value)[i].is_string();
    if (all_text) result.push_back((*value)[i].get<std::string>());
  }
  if (!all_text) document_->fail(Code::kMalformed, dotted(key), "must be a list of texts");
  return result;
}

StrictObject StrictObject::object(const char* key) {
  const nlohmann::json* value = find(key);
  if (value && !value->is_object()) {
    document_->fail(Code::kMalformed, dotted(key), "must be an object, not " + shown(*value));
    value = nullptr;
  }
  return StrictObject(*document_, value ? *value : kEmptyObject, dotted(key));
}

std::optional<StrictObject> StrictObject::object_or_null(const char* key) {
  const nlohmann::json* value = find(key);
  if (!value || value->is_null()) return std::nullopt;
  return object(key);
}

std::vector<StrictObject> StrictObject::objects(const char* key) {
  const nlohmann::json* value = find(key);
  std::vector<StrictObject> result;
  if (!value) return result;
  if (!value->is_array()) {
    document_->fail(Code::kMalformed, dotted(key), "must be a list of objects");
    return result;
  }
  for (size_t i = 0; i < value->size(); ++i) {
    const std::string path = dotted(key) + "[" + std::to_string(i) + "]";
    if (!(*value)[i].is_object()) {
      document_->fail(Code::kMalformed, path, "must be an object, not " + shown((*value)[i]));
    } else {
      result.emplace_back(*document_, (*value)[i], path);
    }
  }
  return result;
}

void StrictObject::close() {
  for (const auto& [key, value] : value_->items()) {
    if (!asked_.contains(key)) {
      document_->fail(Code::kUnknownKey, dotted(key), "is no key this version knows");
    }
  }
}

}  // namespace reforge
