"""Reads a decisions log with the `mcap` package and prints, as JSON, every message with its topic,
encoding, time and schema.

    decisions_in_mcap.py FILE
"""

import json
import sys

from mcap.reader import make_reader

with open(sys.argv[1], "rb") as file:
    messages = [
        {
            "topic": channel.topic,
            "encoding": channel.message_encoding,
            "log_time": message.log_time,
            "schema_name": schema.name,
            "schema_encoding": schema.encoding,
            "schema": json.loads(schema.data),
            "message": json.loads(message.data),
        }
        for schema, channel, message in make_reader(file).iter_messages()
    ]
json.dump(messages, sys.stdout)
