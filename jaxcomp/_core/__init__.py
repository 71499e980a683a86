"""What all packages stand on: fields of parts, roots, statuses, results and quantities."""
